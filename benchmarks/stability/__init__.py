"""`imocap benchmark stability`: whether harmless changes of an action move its result."""
