"""`imocap benchmark wrong_start`: one view's monocular fit is started wrong on purpose."""
