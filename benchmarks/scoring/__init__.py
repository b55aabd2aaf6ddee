"""The numbers of one action: its results, the oracle's, and what they cost."""
