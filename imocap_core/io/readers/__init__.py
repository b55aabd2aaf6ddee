"""Readers of 2D keypoints, one file a format.

`by_name` maps a format's name to its reader; `guess` and `guess_file` recognise format and layout
from the files; `people` has the checks that all readers share; `part_names` sorts body parts into
layouts by their names. `openpose_hands` and `mediapipe_hands` read the performer's hands.
"""
