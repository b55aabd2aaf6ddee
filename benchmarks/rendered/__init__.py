"""`imocap benchmark rendered`: from pixels to motion with a real detector."""
