"""What pickles say of numpy arrays and torch tensors, kept as plain records and built when checked.

numpy's own way of restoring an array believes what a pickle says of its form, and a crafted one
makes it read or write where it must not. Here a pickle's words are only kept; `built` makes arrays
of them with numpy's checked functions.
"""

from __future__ import annotations

import io
import math
import pickle
import re
from typing import Any

import numpy as np
import torch

_CODE = re.compile(r"[biufcSUO]\d{0,9}|\?")


class Marker:
    """Stands for the class numpy.ndarray, which is named but never called."""

    def __init__(self, *arguments: object) -> None:
        raise pickle.UnpicklingError("it would make an array by itself")


class Dtype:
    """The form of an array's numbers: a letter, a size, an order of bytes."""

    def __init__(self, code: Any = None, *_unused: object) -> None:
        if not isinstance(code, str) or not _CODE.fullmatch(code):
            raise pickle.UnpicklingError(f"it holds an array of unknown numbers {code!r:.20}")
        self.code, self.order = code, "="

    def restore(self, state: Any) -> None:
        """As numpy pickles it: (version, order, subarray, names, fields, ...)."""
        known = isinstance(state, tuple) and len(state) >= 5 and state[1] in ("<", ">", "|", "=")
        if not known or any(part is not None for part in state[2:5]):
            raise pickle.UnpicklingError("it holds an array of records")
        self.order = state[1]

    @property
    def dtype(self) -> np.dtype[Any]:
        """numpy's."""
        return np.dtype(self.order + self.code)


class Array:
    """An array as numpy pickles it: (version, shape, dtype, Fortran order, bytes or list)."""

    state: tuple[Any, ...] = ()

    def restore(self, state: Any) -> None:
        """Kept as it is."""
        if not isinstance(state, tuple) or len(state) != 5:
            raise pickle.UnpicklingError("it holds an array that is not complete")
        self.state = state


class JoblibArray:
    """joblib's record before an array's bytes, and these."""

    def __init__(self) -> None:
        self.said: dict[str, Any] = {}
        self.content: Any = b""

    def restore(self, state: Any) -> None:
        """Its attributes: shape, order, dtype, whether the bytes are aligned."""
        if not isinstance(state, dict) or not isinstance(state.get("dtype"), Dtype):
            raise pickle.UnpicklingError("it holds an array that is not complete")
        self.said = state


def array_record(*_unused: object) -> Array:
    """numpy's _reconstruct."""
    return Array()


def from_buffer(buffer: Any, dtype: Any, shape: Any, order: Any) -> np.ndarray:
    """How pickles of protocol 5 write arrays."""
    return _from_bytes(buffer, dtype, shape, order == "F")


def scalar(dtype: Any, content: Any = b"") -> Any:
    """A numpy number."""
    return _from_bytes(content, dtype, (1,), False)[0]


def storage(content: Any) -> Any:
    """The numbers of a torch tensor inside a pickle: a torch file of its own."""
    return torch.load(io.BytesIO(bytes(content)), map_location="cpu", weights_only=True)


def tensor(numbers: Any, offset: Any, size: Any, stride: Any, *_unused: object) -> np.ndarray:
    """A torch tensor as a numpy array: a view of its storage, within it."""
    if not isinstance(numbers, torch.TypedStorage):
        raise pickle.UnpicklingError("it holds a tensor without numbers")
    flat = torch.tensor([], dtype=numbers.dtype).set_(numbers)
    steps = [_count(step) for step in stride]
    last = _count(offset) + sum(max(_count(n) - 1, 0) * s for n, s in zip(size, steps, strict=True))
    if math.prod(size) and last >= len(flat):
        raise pickle.UnpicklingError("it holds a tensor larger than its numbers")
    return flat.as_strided(tuple(size), steps, offset).detach().numpy().copy()


def built(value: Any, done: dict[int, Any] | None = None) -> Any:
    """The same with arrays instead of records, whatever holds them; ValueError or
    UnpicklingError when a record says what can't be."""
    done = {} if done is None else done
    if id(value) not in done:
        done[id(value)] = _built(value, done)
    return done[id(value)]


def _built(value: Any, done: dict[int, Any]) -> Any:
    if isinstance(value, Array) and value.state:
        _, shape, dtype, fortran, content = value.state
        if isinstance(content, list):
            return _of_objects([built(item, done) for item in content], shape)
        return _from_bytes(content, dtype, shape, bool(fortran))
    if isinstance(value, JoblibArray):
        if value.said["dtype"].dtype.hasobject:
            return built(value.content, done)
        said, fortran = value.said, value.said.get("order") == "F"
        return _from_bytes(value.content, said["dtype"], said.get("shape"), fortran)
    if isinstance(value, torch.Tensor):
        return value.detach().cpu().numpy()
    if isinstance(value, dict):
        return {key: built(item, done) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [built(item, done) for item in value]
    return value


def _from_bytes(content: Any, dtype: Any, shape: Any, fortran: bool) -> np.ndarray:
    """An array of some bytes, which must be as many as its form needs."""
    if not isinstance(dtype, Dtype) or not isinstance(content, (bytes, bytearray)):
        raise pickle.UnpicklingError("it holds an array without numbers")
    kind = dtype.dtype
    sizes = _sizes(shape)
    if kind.hasobject or len(content) != math.prod(sizes) * kind.itemsize:
        raise pickle.UnpicklingError(f"it holds an array {sizes} of {len(content)} bytes")
    if not len(content):
        return np.zeros(sizes, kind)
    flat = np.frombuffer(bytes(content), dtype=kind)
    return flat.reshape(sizes, order="F" if fortran else "C").astype(kind.newbyteorder("="))


def _of_objects(items: list[Any], shape: Any) -> np.ndarray:
    sizes = _sizes(shape)
    if len(items) != math.prod(sizes):
        raise pickle.UnpicklingError(f"it holds an array {sizes} of {len(items)} things")
    array = np.empty(len(items), dtype=object)
    for n, item in enumerate(items):
        array[n] = item
    return array.reshape(sizes)


def _sizes(shape: Any) -> tuple[int, ...]:
    if not isinstance(shape, (tuple, list)) or len(shape) > 16:
        raise pickle.UnpicklingError("it holds an array without a shape")
    return tuple(_count(n) for n in shape)


def _count(value: Any) -> int:
    if not isinstance(value, int) or not 0 <= value < 2**40:
        raise pickle.UnpicklingError(f"it holds an array of size {value!r:.20}")
    return int(value)
