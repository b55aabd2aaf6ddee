"""`keypoints: detect`: a 2D detector runs over the videos, in a separate process and environment.

Its detections are written in a format that imocap_core/io/readers reads, so that everything after
it is the same as with keypoints from elsewhere.
"""
