"""Corrections of where a detector marks joints, as a function of the pose in the picture."""
