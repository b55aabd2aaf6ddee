"""Results against the truth, as rows of numbers."""
