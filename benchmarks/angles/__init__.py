"""`imocap benchmark angles`: errors of joint angles and of peak speeds, and of what is stated."""
