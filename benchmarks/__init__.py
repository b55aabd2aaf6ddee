"""Measurements behind `imocap benchmark NAME`; README.md lists them."""
