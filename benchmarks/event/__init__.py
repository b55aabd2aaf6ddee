"""`imocap benchmark event`: cameras calibrated from a performer whom they all film at once."""
