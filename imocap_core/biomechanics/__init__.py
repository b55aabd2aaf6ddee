"""Joint angles as biomechanics defines them (ISB's recommendations)."""
