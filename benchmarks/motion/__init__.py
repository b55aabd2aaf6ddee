"""`imocap benchmark protocol`, `trials`, `yoga`, `h36m`: how good the motion is."""
