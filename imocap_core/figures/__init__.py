"""Figures drawn from artifacts and arrays."""
