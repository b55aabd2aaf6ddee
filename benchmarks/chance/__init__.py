"""`imocap benchmark chance`: what compare's permutation test finds between sets of performances."""
