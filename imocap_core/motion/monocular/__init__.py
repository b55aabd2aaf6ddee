"""The initial SMPL motion of each video by itself (section 3.2)."""
