"""Reading official model pickles without running anything that is in them.

SMPL's .pkl files hold numpy arrays, scipy sparse matrices and chumpy objects. chumpy no longer
imports, and a pickle may name any function, `os.system` included. Here numpy arrays are rebuilt,
chumpy and scipy objects become inert records of their state, and every other name is refused.
"""

from __future__ import annotations

import pickle
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray


class Inert:
    """Stands for an object of a library that is not imported: keeps its state, does nothing."""

    state: Mapping[str, Any] = MappingProxyType({})

    def __init__(self, *arguments: object) -> None:
        """Takes whatever the real class would, and forgets it."""

    def __setstate__(self, state: object) -> None:
        if isinstance(state, dict):
            self.state = state


def _rebuild(kind: type, base: type, state: object) -> object:
    """copyreg's reconstructor, for inert records alone."""
    if not (isinstance(kind, type) and issubclass(kind, Inert)):
        raise pickle.UnpicklingError(f"it would rebuild a {kind!r}")
    return Inert()


_MULTIARRAY = np.empty(0).__reduce__()[0]  # numpy's own _reconstruct, wherever it lives today
_SCALAR = np.float64(0).__reduce__()[0]


def _encode(text: str, encoding: str) -> bytes:
    """How pickles of protocol 2 write bytes."""
    if encoding not in ("latin1", "latin-1"):
        raise pickle.UnpicklingError(f"it would decode bytes as {encoding!r}")
    return text.encode("latin1")


ARRAY_NAMES: dict[tuple[str, str], Any] = {  # what a pickle of arrays needs, and nothing more
    ("numpy", "ndarray"): np.ndarray,
    ("numpy", "dtype"): np.dtype,
    ("_codecs", "encode"): _encode,
}
for _module in ("numpy.core.multiarray", "numpy._core.multiarray"):
    ARRAY_NAMES[_module, "_reconstruct"] = _MULTIARRAY
    ARRAY_NAMES[_module, "scalar"] = _SCALAR
_ALLOWED: dict[tuple[str, str], Any] = {
    **ARRAY_NAMES,
    ("copy_reg", "_reconstructor"): _rebuild,
    ("copyreg", "_reconstructor"): _rebuild,
    ("__builtin__", "object"): object,
    ("builtins", "object"): object,
}


class _Restricted(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        if (module, name) in _ALLOWED:
            return _ALLOWED[module, name]
        if module.split(".")[0] == "chumpy" or module.startswith("scipy.sparse"):
            return Inert
        raise pickle.UnpicklingError(f"it names {module}.{name}, which no body model needs")


def read_pickle(path: Path) -> dict[str, Any]:
    """The dictionary in a model's .pkl file; ValueError when it is damaged or unsafe."""
    try:
        with path.open("rb") as stream:
            content = _Restricted(stream, encoding="latin1").load()
    except (
        pickle.UnpicklingError,
        EOFError,
        AttributeError,
        IndexError,
        KeyError,
        TypeError,
        ValueError,
        MemoryError,
    ) as error:
        raise ValueError(
            f"{path}: refused, this is not a body model that can be read safely: {error}. "
            "Give the official file as downloaded, or an .npz of its arrays."
        ) from error
    if not isinstance(content, dict):
        raise ValueError(f"{path}: expected a dictionary of arrays, got {type(content).__name__}")
    return content


def as_array(value: object) -> NDArray[np.generic]:
    """A numpy array from what a model file may hold: array, sparse matrix or chumpy object."""
    if not isinstance(value, Inert):
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


def _dense(state: Mapping[str, Any]) -> NDArray[np.generic]:
    """A compressed sparse column matrix, written out."""
    rows, columns = state["_shape"]
    indices, starts = as_array(state["indices"]), as_array(state["indptr"])
    if len(starts) != columns + 1:
        raise ValueError(f"a sparse matrix {rows}x{columns} is not stored by columns")
    dense = np.zeros((rows, columns))
    dense[indices, np.repeat(np.arange(columns), np.diff(starts))] = as_array(state["data"])
    return dense
