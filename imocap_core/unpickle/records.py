"""What pickles state about numpy arrays and torch tensors: plain records, turned into arrays later.

numpy's own way of restoring an array believes what a pickle states about its form, and a crafted
one makes it read or write where it must not. Here these statements are only stored; `build` makes
arrays of them with numpy's checked functions.
"""

from __future__ import annotations

import io
import math
import pickle
import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
import torch

from imocap_core.limits import MAX_ELEMENTS

_CODE = re.compile(r"[biufcSUO]\d{0,9}|\?")


class NdarrayClass:
    """Stands for the class numpy.ndarray, which is named but never called."""

    def __init__(self, *arguments: object) -> None:
        raise pickle.UnpicklingError("it would make an array by itself")


class InertObject:
    """Stands for an object of a library that is not imported: stores its state, does nothing."""

    state: Mapping[str, Any] = MappingProxyType({})

    def __init__(self, *arguments: object) -> None:
        """Takes whatever the real class would, and ignores it."""

    def restore(self, state: object) -> None:
        """Its attributes."""
        if isinstance(state, dict):
            self.state = state


class DtypeRecord:
    """The type of an array's numbers: a letter, a size, an order of bytes."""

    def __init__(self, code: Any = None, *_unused: object) -> None:
        if not isinstance(code, str) or not _CODE.fullmatch(code):
            raise pickle.UnpicklingError(f"it contains an array of unknown numbers {code!r:.20}")
        self.code, self.order = code, "="

    def restore(self, state: Any) -> None:
        """As numpy pickles it: (version, order, subarray, names, fields, ...)."""
        valid = isinstance(state, tuple) and len(state) >= 5 and state[1] in ("<", ">", "|", "=")
        if not valid or any(part is not None for part in state[2:5]):
            raise pickle.UnpicklingError("it contains an array of records")
        self.order = state[1]

    @property
    def dtype(self) -> np.dtype[Any]:
        """numpy's."""
        return np.dtype(self.order + self.code)


class ArrayRecord:
    """An array as numpy pickles it: (version, shape, dtype, Fortran order, bytes or list)."""

    state: tuple[Any, ...] = ()

    def restore(self, state: Any) -> None:
        """Stored as it is."""
        if not isinstance(state, tuple) or len(state) != 5:
            raise pickle.UnpicklingError("it contains an array that is not complete")
        self.state = state


class JoblibRecord:
    """joblib's record before an array's bytes, and these bytes."""

    def __init__(self) -> None:
        self.state: dict[str, Any] = {}
        self.content: Any = b""

    def restore(self, state: Any) -> None:
        """Its attributes: shape, order, dtype, whether the bytes are aligned."""
        if not isinstance(state, dict) or not isinstance(state.get("dtype"), DtypeRecord):
            raise pickle.UnpicklingError("it contains an array that is not complete")
        self.state = state


def array_record(*_unused: object) -> ArrayRecord:
    """numpy's _reconstruct."""
    return ArrayRecord()


def from_buffer(buffer: Any, dtype: Any, shape: Any, order: Any) -> np.ndarray:
    """How pickles of protocol 5 write arrays."""
    return _from_bytes(buffer, dtype, shape, order == "F")


def scalar(dtype: Any, content: Any = b"") -> Any:
    """A numpy number, as Python's: it may be a dictionary's key, as ids from np.unique are."""
    return _from_bytes(content, dtype, (1,), False)[0].item()


def storage(content: Any) -> Any:
    """The numbers of a torch tensor inside a pickle: a torch file of its own."""
    return torch.load(io.BytesIO(bytes(content)), map_location="cpu", weights_only=True)


def tensor(numbers: Any, offset: Any, size: Any, stride: Any, *_unused: object) -> np.ndarray:
    """A torch tensor as a numpy array: a view of its storage, within it."""
    if not isinstance(numbers, torch.TypedStorage):
        raise pickle.UnpicklingError("it contains a tensor without numbers")
    flat = torch.tensor([], dtype=numbers.dtype).set_(numbers)
    steps = [_count(step) for step in stride]
    last = _count(offset) + sum(max(_count(n) - 1, 0) * s for n, s in zip(size, steps, strict=True))
    if math.prod(map(_count, size)) > MAX_ELEMENTS:
        raise pickle.UnpicklingError(f"it contains a tensor {tuple(size)}, which is too large")
    if math.prod(size) and last >= len(flat):
        raise pickle.UnpicklingError("it contains a tensor larger than its numbers")
    return flat.as_strided(tuple(size), steps, offset).detach().numpy().copy()


def build(value: Any, done: dict[int, Any] | None = None) -> Any:
    """The same with arrays instead of records, in whatever containers; ValueError or
    UnpicklingError when a record states what can't be."""
    done = {} if done is None else done
    if id(value) not in done:
        if isinstance(value, InertObject):
            done[id(value)] = value  # before its state, which may refer back to it
            value.state = {name: build(part, done) for name, part in value.state.items()}
        else:
            done[id(value)] = _built(value, done)
    return done[id(value)]


def _built(value: Any, done: dict[int, Any]) -> Any:
    if isinstance(value, ArrayRecord) and value.state:
        _, shape, dtype, fortran, content = value.state
        if isinstance(content, list):
            return _of_objects([build(item, done) for item in content], shape)
        return _from_bytes(content, dtype, shape, bool(fortran))
    if isinstance(value, JoblibRecord):
        state = value.state
        if state["dtype"].dtype.hasobject:
            return build(value.content, done)
        fortran = state.get("order") == "F"
        return _from_bytes(value.content, state["dtype"], state.get("shape"), fortran)
    if isinstance(value, torch.Tensor):
        return value.detach().cpu().numpy()
    if isinstance(value, dict):
        return {key: build(item, done) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [build(item, done) for item in value]
    return value


def _from_bytes(content: Any, dtype: Any, shape: Any, fortran: bool) -> np.ndarray:
    """An array of some bytes, which must be as many as its form needs."""
    if isinstance(content, str):  # Python 2's bytes
        content = content.encode("latin1")
    if isinstance(dtype, DtypeRecord) and not dtype.dtype.itemsize:
        raise pickle.UnpicklingError("it contains an array of empty words")
    if not isinstance(dtype, DtypeRecord) or not isinstance(content, (bytes, bytearray)):
        raise pickle.UnpicklingError("it contains an array without numbers")
    kind = dtype.dtype
    sizes = _sizes(shape)
    if kind.hasobject or len(content) != math.prod(sizes) * kind.itemsize:
        raise pickle.UnpicklingError(f"it contains an array {sizes} of {len(content)} bytes")
    if not len(content):
        return np.zeros(sizes, kind)
    flat = np.frombuffer(bytes(content), dtype=kind)
    return flat.reshape(sizes, order="F" if fortran else "C").astype(kind.newbyteorder("="))


def _of_objects(items: list[Any], shape: Any) -> np.ndarray:
    sizes = _sizes(shape)
    if len(items) != math.prod(sizes):
        raise pickle.UnpicklingError(f"it contains an array {sizes} of {len(items)} things")
    array = np.empty(len(items), dtype=object)
    for n, item in enumerate(items):
        array[n] = item
    return array.reshape(sizes)


def _sizes(shape: Any) -> tuple[int, ...]:
    if not isinstance(shape, (tuple, list)) or len(shape) > 16:
        raise pickle.UnpicklingError("it contains an array without a shape")
    return tuple(_count(n) for n in shape)


def _count(value: Any) -> int:
    if not isinstance(value, int) or not 0 <= value < 2**40:
        raise pickle.UnpicklingError(f"it contains an array of size {value!r:.20}")
    return int(value)
