"""`imocap benchmark body` and `bones`: speed and fit of the body model."""
