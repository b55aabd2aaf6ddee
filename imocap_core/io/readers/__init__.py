"""Readers of 2D keypoints and of monocular 3D estimates, by families of formats."""
