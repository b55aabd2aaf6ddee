"""`imocap benchmark speed` (`make bench`): each fast part beside a named alternative."""
