"""Cameras: projection, pose and intrinsics estimation, background motion, the world frame."""
