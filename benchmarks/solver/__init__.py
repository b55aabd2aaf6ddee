"""`imocap benchmark solver`: the speed of the solver, and its rivals."""
