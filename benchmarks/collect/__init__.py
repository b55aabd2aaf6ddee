"""`imocap benchmark collect`: compilation films made in code, and what is collected from them.

Reading order:
    takes      performances rendered by a static camera, kept as small films
    edit       takes cut into a film: transitions, replays, captions, mirrored and still shots
    films      the films that are measured, and those that the defaults were chosen on
    truth      shots and occurrences of a film, and how a list of collected ones compares
    measure    every film collected, and the table
"""
