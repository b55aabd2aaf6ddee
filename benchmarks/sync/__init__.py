"""`imocap benchmark sync`: synchronisation alone."""
