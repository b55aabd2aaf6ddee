"""Projection, rotation and zoom from the background, PnP, averaging of rotations."""
