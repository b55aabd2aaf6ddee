"""What the stages hand to one another: schemas, the MCAP codec, the store.

`schemas` says what an artifact holds, `codec` how it lies in a file, `store` where the file lies.
"""
