"""Readers of monocular 3D estimates, one file a format.

`by_name` maps a format's name to its reader; `estimates` has the checks that all readers share and
finds the performer among several people; `persons` reads results with one dictionary per person.
"""
