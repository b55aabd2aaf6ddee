"""Scripts that run in a detector's own environment: they import nothing of this project.

Each gets its settings as JSON in its first argument, then pictures on its standard input (three
little-endian 32-bit numbers: frame, height, width; then the RGB bytes), and answers with lines of
JSON on its standard output: first {"ready": ...}, then one object a picture. {"fault": "..."} is
what it cannot go on after.
"""
