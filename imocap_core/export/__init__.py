"""Results for other programs: the files of `imocap export`."""
