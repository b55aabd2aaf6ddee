"""`imocap benchmark ablations`: what each part of the method is worth."""
