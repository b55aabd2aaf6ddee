"""Comparison of an action's performances with each other, and of two performers."""
