"""Whose keypoints these are: sides, looks, the performer among several, cuts between shots."""
