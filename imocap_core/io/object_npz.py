"""npz files whose arrays contain Python objects, read without running code from the file.

numpy stores such arrays as pickles (`imocap_core.unpickle`).
"""

from __future__ import annotations

import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy

from imocap_core.io.npz import unpacked_size
from imocap_core.limits import must_unpack_to_little
from imocap_core.unpickle import UNREADABLE, load_pickle


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
                version = npy.read_magic(stream)
                header = npy.read_array_header_1_0 if version == (1, 0) else _header_2
                shape, _, dtype = header(stream)
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


def _header_2(stream: Any) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    return npy.read_array_header_2_0(stream)
