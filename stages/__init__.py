"""The eight stages, each a short script: read -> call the core -> write."""
