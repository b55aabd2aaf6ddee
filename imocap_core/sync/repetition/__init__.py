"""Repetitions of one action in a long clip."""
