"""Metrics, one function each; docs/metrics.md defines them all in words."""
