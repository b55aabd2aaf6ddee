"""Solvers that are only raced against Gauss-Newton."""
