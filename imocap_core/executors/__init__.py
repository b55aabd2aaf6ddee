"""Graphs of tasks, carried out in sequence, in processes, or by a Dask cluster."""
