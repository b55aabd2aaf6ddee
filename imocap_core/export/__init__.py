"""What a run gave, for other programs: the files of `imocap export`."""
