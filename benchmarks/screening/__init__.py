"""`imocap benchmark screening`: 100 made scenes with a stranger, a mirrored video, or neither."""
