"""`imocap collect`: from long films to the videos of an action."""
