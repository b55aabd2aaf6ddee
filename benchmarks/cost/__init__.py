"""`imocap benchmark cost`: what an action costs, as a function of its size."""
