"""The arrays in an official model's .pkl file, read without running anything that is in it.

SMPL's .pkl files hold numpy arrays, scipy sparse matrices and chumpy objects. chumpy no longer
imports: its objects and scipy's become inert records (`imocap_core.unpickle`), and their arrays are
taken out of these.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from imocap_core.unpickle import UNREADABLE, InertObject, load_pickle


def read_model_pickle(path: Path) -> dict[str, Any]:
    """The dictionary in a model's .pkl file; ValueError when it is damaged or unsafe."""
    try:
        content = load_pickle(path.read_bytes(), inert_modules=("chumpy", "scipy.sparse"))
    except UNREADABLE as error:
        raise ValueError(
            f"{path}: refused, this is not a body model that can be read safely: {error}. "
            "Give the official file as downloaded, or an .npz of its arrays."
        ) from error
    if not isinstance(content, dict):
        raise ValueError(f"{path}: expected a dictionary of arrays, got {type(content).__name__}")
    return content


def as_array(value: object) -> np.ndarray:
    """A numpy array from what a model file may hold: array, sparse matrix or chumpy object."""
    if not isinstance(value, InertObject):
        return np.asarray(value)
    state = value.state
    if "indptr" in state and "_shape" in state:
        return _dense(state)
    if "x" in state:  # chumpy.Ch: the array itself
        return as_array(state["x"])
    if "a" in state and "idxs" in state:  # chumpy's Select: some entries of another array
        chosen = as_array(state["a"]).ravel()[as_array(state["idxs"])]
        shape = state.get("preferred_shape")
        return chosen.reshape(shape) if shape is not None else chosen
    raise ValueError(f"an object with fields {sorted(state)} holds no array")


def _dense(state: Mapping[str, Any]) -> np.ndarray:
    """A compressed sparse column matrix, written out."""
    rows, columns = state["_shape"]
    indices, starts = as_array(state["indices"]), as_array(state["indptr"])
    if len(starts) != columns + 1:
        raise ValueError(f"a sparse matrix {rows}x{columns} is not stored by columns")
    dense = np.zeros((rows, columns))
    dense[indices, np.repeat(np.arange(columns), np.diff(starts))] = as_array(state["data"])
    return dense
