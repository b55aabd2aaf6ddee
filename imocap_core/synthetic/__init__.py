"""A made world with known truth: one action, many performances, cameras, rooms, a detector."""
