"""`imocap benchmark degraded`: the whole pipeline on degraded real footage."""
