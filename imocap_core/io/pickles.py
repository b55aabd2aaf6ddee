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
import math
import pickle
import re
import struct
import tokenize
import warnings
import zipfile
import zlib
from collections import OrderedDict, defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.lib import format as npy

from imocap_core.io.detectors.people import must_be_file
from imocap_core.io.pickled_arrays import (
    Array,
    Dtype,
    JoblibArray,
    Marker,
    array_record,
    built,
    from_buffer,
    scalar,
    storage,
    tensor,
)

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
    *(
        SyntaxError,
        tokenize.TokenError,
        AssertionError,
        struct.error,
        zlib.error,
        lzma.LZMAError,
        zipfile.BadZipFile,
    ),
)


def _encode(text: Any, encoding: Any) -> bytes:
    """How pickles of protocol 2 write bytes."""
    if not isinstance(text, str) or encoding not in ("latin1", "latin-1"):
        raise pickle.UnpicklingError(f"it would decode bytes as {encoding!r:.20}")
    return text.encode("latin1")


def _no_bytes(*content: Any) -> bytes:
    """How pickles of protocol 2 write no bytes at all."""
    if content:
        raise pickle.UnpicklingError("it would make bytes of something")
    return b""


_ALLOWED: dict[tuple[str, str], Any] = {
    ("numpy", "ndarray"): Marker,
    ("numpy", "dtype"): Dtype,
    ("_codecs", "encode"): _encode,
    ("joblib.numpy_pickle", "NumpyArrayWrapper"): JoblibArray,
    ("collections", "OrderedDict"): OrderedDict,
    ("collections", "defaultdict"): defaultdict,
    ("torch._utils", "_rebuild_tensor_v2"): tensor,
    ("torch.storage", "_load_from_bytes"): storage,
}
for _core in ("numpy.core", "numpy._core"):
    _ALLOWED[f"{_core}.multiarray", "_reconstruct"] = array_record
    _ALLOWED[f"{_core}.multiarray", "scalar"] = scalar
    _ALLOWED[f"{_core}.numeric", "_frombuffer"] = from_buffer
for _module in ("builtins", "__builtin__"):
    _ALLOWED[_module, "bytes"] = _no_bytes
    for _kind in (dict, list, tuple, set, bytearray):
        _ALLOWED[_module, _kind.__name__] = _kind


class Arrays(pickle._Unpickler):
    """Python's own unpickler (it reads no byte too many), with nothing to call but `_ALLOWED`,
    and nothing to change but the records of arrays."""

    def __init__(self, stream: io.BytesIO) -> None:
        super().__init__(stream, encoding="latin1")
        self._raw = stream

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in _ALLOWED:
            raise pickle.UnpicklingError(f"it names {module}.{name}, which no result needs")
        return _ALLOWED[module, name]

    def load_build(self) -> None:
        stack: list[Any] = self.stack  # type: ignore[attr-defined]
        state, record = stack.pop(), stack[-1]
        if not isinstance(record, (Array, Dtype, JoblibArray)):
            raise pickle.UnpicklingError(f"it would change a {type(record).__name__}")
        record.restore(state)
        if isinstance(record, JoblibArray):
            self._read_content(record)

    def _read_content(self, record: JoblibArray) -> None:
        """The array that follows its record: another pickle, or bytes after some padding."""
        dtype = record.said["dtype"].dtype
        if dtype.hasobject:
            record.content = Arrays(self._raw).load()
            return
        if record.said.get("numpy_array_alignment_bytes") is not None:
            self._raw.read(self._raw.read(1)[0])
        shape = record.said.get("shape")
        count = math.prod(shape) if isinstance(shape, tuple) else 0
        record.content = self._raw.read(max(0, count) * dtype.itemsize)

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
        return built(_load(path.read_bytes()))
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
    found = Arrays(io.BytesIO(content)).load()
    return _load_torch(content) if _is_torch_magic(found) else found


def _is_torch_magic(found: Any) -> bool:
    return isinstance(found, int) and found == _TORCH_MAGIC


def _load_torch(content: bytes) -> Any:
    """torch's own restricted reader; its advice to read the file without it is left out."""
    try:
        with warnings.catch_warnings(action="ignore"):  # of odd files, which are refused or not
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
    found = built(Arrays(stream).load())
    return found.item() if isinstance(found, np.ndarray) and found.shape == () else found
