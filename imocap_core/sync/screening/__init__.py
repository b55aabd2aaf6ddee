"""Videos that are mirrored, and videos of another action."""
