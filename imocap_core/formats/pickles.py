"""Results stored as pickles (pickle, joblib, .npy of objects, .pt): read without running anything.

A pickle may name any function, `os.system` included. Here numpy arrays, torch tensors and Python's
own containers are rebuilt, and every other name is refused. joblib's files are pickles, often
compressed, in which an array is a small record followed at once by the array's bytes (one byte
says how many bytes of padding come first); both are read here, so joblib is not needed.
"""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import pickle
import re
import struct
import zipfile
import zlib
from collections import OrderedDict, defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.lib import format as npy

from imocap_core.body.unpickle import ARRAY_NAMES
from imocap_core.formats.people import must_be_file

_DECOMPRESS: tuple[tuple[bytes, Callable[[bytes], bytes]], ...] = (
    (b"\x78", zlib.decompress),
    (b"\x1f\x8b", gzip.decompress),
    (b"BZh", bz2.decompress),
    (b"\xfd7zXZ", lzma.decompress),
    (b"\x5d\x00", lzma.decompress),
)
_TORCH_MAGIC = 0x1950A86A20F9469CFC6C  # what .pt files of before torch 1.6 begin with
_UNREADABLE = (
    *(pickle.UnpicklingError, AttributeError, IndexError, KeyError, TypeError, ValueError),
    *(MemoryError, OverflowError, RecursionError, EOFError, OSError, RuntimeError),
    *(AssertionError, struct.error, zlib.error, lzma.LZMAError, zipfile.BadZipFile),
)


class _JoblibArray:
    """The record before an array's bytes: shape, order, dtype, whether they are aligned."""

    shape: Any = ()
    order: Any = "C"
    dtype: Any = None
    numpy_array_alignment_bytes: Any = None


def _tensor_storage(content: bytes) -> Any:
    """The numbers of a torch tensor inside a pickle: a torch file of its own."""
    return _load_torch(content)


def _from_buffer(buffer: Any, dtype: Any, shape: Any, order: Any) -> np.ndarray:
    """How pickles of protocol 5 write arrays."""
    return np.frombuffer(buffer, dtype=dtype).reshape(shape, order=order)


_ALLOWED: dict[tuple[str, str], Any] = {
    **ARRAY_NAMES,
    ("numpy.core.numeric", "_frombuffer"): _from_buffer,
    ("numpy._core.numeric", "_frombuffer"): _from_buffer,
    ("joblib.numpy_pickle", "NumpyArrayWrapper"): _JoblibArray,
    ("collections", "OrderedDict"): OrderedDict,
    ("collections", "defaultdict"): defaultdict,
    ("torch._utils", "_rebuild_tensor_v2"): torch._utils._rebuild_tensor_v2,  # as weights_only does
    ("torch.storage", "_load_from_bytes"): _tensor_storage,
}
for _module in ("builtins", "__builtin__"):
    for _kind in (dict, list, tuple, set, bytearray):
        _ALLOWED[_module, _kind.__name__] = _kind


class _Arrays(pickle._Unpickler):
    """Python's own unpickler (it reads no byte too many), with nothing to call but `_ALLOWED`."""

    def __init__(self, stream: io.BytesIO) -> None:
        super().__init__(stream, encoding="latin1")
        self._raw = stream

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in _ALLOWED:
            raise pickle.UnpicklingError(f"it names {module}.{name}, which no result needs")
        return _ALLOWED[module, name]

    def load_build(self) -> None:
        super().load_build()  # type: ignore[misc]
        stack: list[Any] = self.stack  # type: ignore[attr-defined]
        if isinstance(stack[-1], _JoblibArray):
            stack[-1] = self._array(stack[-1])

    def _array(self, record: _JoblibArray) -> np.ndarray:
        dtype = np.dtype(record.dtype)
        if dtype.hasobject:
            return np.asarray(_Arrays(self._raw).load())
        if record.numpy_array_alignment_bytes is not None:
            self._raw.read(self._raw.read(1)[0])
        shape = tuple(int(n) for n in record.shape)
        count = int(np.prod(shape, dtype=object))
        content = self._raw.read(count * dtype.itemsize)
        array = np.frombuffer(content, dtype=dtype, count=count)
        return array.reshape(shape, order="F" if record.order == "F" else "C")

    dispatch: ClassVar[dict[int, Any]] = {
        **pickle._Unpickler.dispatch,
        pickle.BUILD[0]: load_build,
    }


def read_results(path: Path) -> Any:
    """What a .pkl, .npy or .pt file holds, tensors as numpy arrays.

    Raises:
        ValueError: the file is missing or damaged, or would run code.
    """
    must_be_file(path, "initial")
    try:
        return _plain(_load(path.read_bytes()))
    except _UNREADABLE as error:
        said = " ".join(str(error).split("\n")[0].split()) or type(error).__name__
        raise ValueError(
            f"{path}: refused, this is no result that can be read safely: {said}; give the file "
            "as the estimator wrote it"
        ) from None


def _load(content: bytes) -> Any:
    if not content:
        raise ValueError("the file is empty")
    if content.startswith(npy.MAGIC_PREFIX):
        return _load_npy(io.BytesIO(content))
    if content.startswith(b"PK"):
        return _load_torch(content)
    for magic, decompress in _DECOMPRESS:
        if content.startswith(magic):
            content = decompress(content)
            break
    found = _Arrays(io.BytesIO(content)).load()
    return _load_torch(content) if _is_torch_magic(found) else found


def _is_torch_magic(found: Any) -> bool:
    return isinstance(found, int) and found == _TORCH_MAGIC


def _load_torch(content: bytes) -> Any:
    """torch's own restricted reader; its advice to read the file without it is left out."""
    try:
        return torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
    except pickle.UnpicklingError as error:
        named = re.search(r"GLOBAL ([\w.]+)", str(error))
        what = named[1] if named else "something besides tensors and plain values"
        raise pickle.UnpicklingError(f"it names {what}, which no result needs") from None


def _load_npy(stream: io.BytesIO) -> Any:
    version = npy.read_magic(stream)
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    _, _, dtype = read(stream)
    if not dtype.hasobject:
        stream.seek(0)
        return np.load(stream, allow_pickle=False)
    found = _Arrays(stream).load()
    return found.item() if isinstance(found, np.ndarray) and found.shape == () else found


def _plain(value: Any) -> Any:
    """The same with tensors as numpy arrays."""
    if isinstance(value, torch.Tensor):
        return value.detach().cpu().numpy()
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return value
