"""A learned lifter: a person's 2D keypoints over time to 3D joints, whatever the detector."""
