"""From affinities to warps: which frame of one video matches which of another."""
