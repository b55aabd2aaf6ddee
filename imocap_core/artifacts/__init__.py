"""Artifacts, the results of stages: schemas, the MCAP codec, the store.

`schemas` defines what an artifact contains, `codec` how it is written to a file, `store` where.
"""
