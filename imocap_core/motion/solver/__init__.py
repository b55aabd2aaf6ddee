"""Damped Gauss-Newton on block-banded normal equations; it knows residuals, not bodies."""
