"""From artifacts to what is solved, and back."""
