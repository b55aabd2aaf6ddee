"""`imocap benchmark collect`: compilation films made in code, and what is collected from them.

Reading order:
    takes      performances rendered by a static camera, kept as small films
    edit       takes cut into a film: transitions, replays, captions, mirrored and still shots
    films      the films that are measured
    truth      shots and occurrences of a film, and how a list of collected ones compares
    motion     the truth of a collected action, and the same takes as clean clips
    measure    every film collected
    report     the tables
"""
