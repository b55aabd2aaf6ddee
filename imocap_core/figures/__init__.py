"""Figures: what people look at, drawn from arrays and artifacts."""
