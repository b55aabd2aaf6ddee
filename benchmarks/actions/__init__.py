"""Captured motion as action folders: what a benchmark's stages are given."""
