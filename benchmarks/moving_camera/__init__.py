"""Cameras that move from their place: told from tripods, and followed."""
