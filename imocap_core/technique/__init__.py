"""How alike performances of one action are, and how they differ: docs/technique.md."""
