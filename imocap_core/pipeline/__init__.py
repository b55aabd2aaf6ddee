"""What the stages share: the action, the graph, keys, the runner. Nothing here computes."""
