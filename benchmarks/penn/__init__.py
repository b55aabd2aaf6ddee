"""Real clips with hand-made labels (Penn Action): evaluation alone."""
