"""`imocap benchmark performers`: one action by two performers, each with a body of its own."""
