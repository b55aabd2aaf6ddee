"""BlazePose assembled from its two networks: a person detector, then 33 landmarks in a crop; and
MoveNet, which looks at the limbs too.

Runs in the detector's own environment (numpy, cv2); the networks are given as functions.
"""
