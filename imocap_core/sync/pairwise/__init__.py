"""How alike the frames of two videos are (Eq. 1)."""
