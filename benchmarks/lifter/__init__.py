"""`imocap benchmark lifter`: the 2D to 3D lifter alone."""
