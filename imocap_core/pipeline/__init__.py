"""Action files, the graph of stages, keys, and the runner. Nothing here computes."""
