"""Results scored against the truth, as rows of numbers."""
