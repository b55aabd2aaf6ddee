"""`keypoints: detect`: a 2D detector run over the videos, in a process and environment of its own.

What it finds is written in a format that imocap_core/formats reads, so that everything after it is
as with keypoints that somebody brought.
"""
