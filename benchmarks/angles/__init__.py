"""`imocap benchmark angles`: errors of joint angles and peak speeds, and how well they are known."""
