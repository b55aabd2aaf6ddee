"""`imocap benchmark trust`: videos of another action and mirrored ones."""
