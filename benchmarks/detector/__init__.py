"""`imocap benchmark detector`: the default detector on plain and on degraded footage."""
