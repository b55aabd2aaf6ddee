"""Joint choice of one monocular motion for each video, among several hypotheses."""
