"""`imocap benchmark performances`: one action by 2, 4, 8, ... performances, and how they differ."""
