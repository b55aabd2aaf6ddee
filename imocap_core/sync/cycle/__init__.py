"""Cycle consistency: pairwise affinities made to agree over all videos (Eq. 2)."""
