"""Arrays of pickled files, checked; Python objects are read without running code.

numpy stores such arrays as pickles (`imocap_core.unpickle`).
"""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import pickle
import re
import warnings
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.lib import format as npy

from imocap_core.io.npz import unpacked_size
from imocap_core.io.readers.people import must_be_file
from imocap_core.limits import MAX_UNPACKED_BYTES, must_be_small_enough, must_unpack_to_little
from imocap_core.unpickle import UNREADABLE, build, load_pickle


def read_object(path: Path, name: str) -> Any:
    """The one object in array ``name`` of an npz file. ValueError when it is missing, damaged, or
    would run code."""
    if not path.is_file():
        raise ValueError(f"{path}: no such file")
    try:
        must_unpack_to_little(unpacked_size(path))
        with zipfile.ZipFile(path) as archive:
            members = archive.namelist()
            if f"{name}.npy" not in members:
                have = ", ".join(sorted(m.removesuffix(".npy") for m in members)) or "nothing"
                raise ValueError(
                    f"{path}: {name}: expected an array of that name, the file has {have}"
                )
            with archive.open(f"{name}.npy") as stream:
                shape, dtype = _npy_header(stream)
                if shape != () or not dtype.hasobject:
                    raise ValueError(
                        f"{path}: {name}: expected one Python object, got {dtype} {shape}"
                    )
                return load_pickle(stream.read()).item()
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, RuntimeError) as error:
        raise ValueError(f"{path}: is not a readable npz file ({error}); get it again") from None
    except UNREADABLE as error:
        if str(error).startswith(f"{path}: "):
            raise
        raise ValueError(
            f"{path}: {name}: refused, it can't be read safely: {error}; get the file from where "
            "it was published"
        ) from None


def _npy_header(stream: Any) -> tuple[tuple[int, ...], np.dtype[Any]]:
    version = npy.read_magic(stream)
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, _, dtype = read(stream)
    return shape, dtype


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
    _, dtype = _npy_header(stream)
    if not dtype.hasobject:
        return np.load(io.BytesIO(content), allow_pickle=False)
    value = load_pickle(stream.read())
    return value.item() if isinstance(value, np.ndarray) and value.shape == () else value
