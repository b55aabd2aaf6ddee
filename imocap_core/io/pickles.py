"""Results stored as pickles (pickle, joblib, .npy of objects, .pt), often compressed, read without
running code from the file (`imocap_core.unpickle`)."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import pickle
import re
import warnings
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.lib import format as npy

from imocap_core.io.detectors.people import must_be_file
from imocap_core.io.npz import unpacked_size
from imocap_core.limits import MAX_UNPACKED_BYTES, must_be_small_enough, must_unpack_to_little
from imocap_core.unpickle import UNREADABLE, build, load_pickle

_PACKED: dict[bytes, Callable[[io.BytesIO], Any]] = {
    b"\x1f\x8b": lambda stream: gzip.GzipFile(fileobj=stream),
    b"BZh": bz2.BZ2File,
    b"\xfd7zXZ": lzma.LZMAFile,
    b"\x5d\x00": lzma.LZMAFile,
}
_ZLIB = b"\x78"
_TORCH_MAGIC = 0x1950A86A20F9469CFC6C  # what .pt files of before torch 1.6 begin with


def read_results(path: Path) -> Any:
    """The content of a .pkl, .npy or .pt file, tensors as numpy arrays.

    Raises:
        ValueError: the file is missing or damaged, or would run code.
    """
    must_be_file(path, "initial")
    must_be_small_enough(path)
    try:
        return _load(path.read_bytes())
    except UNREADABLE as error:
        reason = " ".join(str(error).split("\n")[0].split()) or type(error).__name__
        raise ValueError(
            f"{path}: refused, it cannot be read safely: {reason}; give the file "
            "as the estimator wrote it"
        ) from None


def _load(content: bytes) -> Any:
    if not content:
        raise ValueError("the file is empty")
    if content.startswith(npy.MAGIC_PREFIX):
        return _load_npy(content)
    if content.startswith(b"PK"):
        must_unpack_to_little(unpacked_size(io.BytesIO(content)))
        return _load_torch(content)
    value = load_pickle(_unpacked(content))
    return _load_torch(content) if isinstance(value, int) and value == _TORCH_MAGIC else value


def _unpacked(content: bytes) -> bytes:
    """The content of a compressed file, or the content itself; ValueError when it is too large."""
    if content.startswith(_ZLIB):
        unpacked = zlib.decompressobj().decompress(content, MAX_UNPACKED_BYTES + 1)
    else:
        reader = next((r for magic, r in _PACKED.items() if content.startswith(magic)), None)
        if reader is None:
            return content
        with reader(io.BytesIO(content)) as packed:
            unpacked = packed.read(MAX_UNPACKED_BYTES + 1)
    must_unpack_to_little(len(unpacked))
    return unpacked


def _load_torch(content: bytes) -> Any:
    """Read with torch's restricted reader; its advice to read the file without it is left out."""
    try:
        with warnings.catch_warnings(action="ignore"):  # of odd files, which are refused or not
            return build(torch.load(io.BytesIO(content), map_location="cpu", weights_only=True))
    except pickle.UnpicklingError as error:
        named = re.search(r"GLOBAL ([\w.]+)", str(error))
        what = named[1] if named else "something besides tensors and plain values"
        raise pickle.UnpicklingError(f"it names {what}, which no result needs") from None


def _load_npy(content: bytes) -> Any:
    stream = io.BytesIO(content)
    version = npy.read_magic(stream)
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    _, _, dtype = read(stream)
    if not dtype.hasobject:
        return np.load(io.BytesIO(content), allow_pickle=False)
    value = load_pickle(stream.read())
    return value.item() if isinstance(value, np.ndarray) and value.shape == () else value
