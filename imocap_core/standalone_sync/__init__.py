"""`imocap sync`: synchronisation alone, and long clips cut into repetitions."""
