"""The results of a run as values: the one place where an action's artifacts become arrays."""
