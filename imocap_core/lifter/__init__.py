"""A learned 2D-to-3D lifter: a person's keypoints over time to 3D joints, for any detector."""
