"""BlazePose assembled from its two networks: a person detector, then 33 landmarks in a crop.

Runs in the detector's own environment (numpy, cv2); the networks are given as functions.
"""
