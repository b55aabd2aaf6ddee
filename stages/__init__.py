"""The ten stages, each a short script: read -> call the core -> write."""
