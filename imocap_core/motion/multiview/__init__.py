"""SMPL-BA: one motion common to all videos, and each video's deviation from it (Eq. 4 to 8)."""
