"""Readers of what monocular 3D estimators write, a format a file."""
