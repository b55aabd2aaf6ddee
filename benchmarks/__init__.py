"""Measurements behind `imocap benchmark NAME`, one module each, returning rows for a table."""
