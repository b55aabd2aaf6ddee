"""Readers of what 2D keypoint detectors write, a format a file."""
