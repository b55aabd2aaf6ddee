"""Synthetic data with known truth: performances of one action, cameras, rooms, a detector."""
