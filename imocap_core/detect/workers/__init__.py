"""Scripts that run in a detector's own environment: they import nothing of this project.

The first argument of each is its settings as JSON. Pictures come on its standard input: three
little-endian 32-bit numbers (frame, height, width), then the RGB bytes. It answers with lines of
JSON on its standard output: first {"ready": ...}, then one object a picture; {"fault": "..."}
before it ends with an error.
"""
