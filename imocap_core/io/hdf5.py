"""HDF5 files by h5py (the optional extra `h5`), their content only.

An HDF5 file can name other files of the machine as its content (external links, external and
virtual datasets): these are refused. So is what unpacks to too much, and a damaged file with which
HDF5's library does not come back.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Shaped

from imocap_core.io.detectors.people import must_be_file
from imocap_core.limits import must_be_small_enough, must_unpack_to_little

TRIAL = "imocap_core.io.hdf5_trial"
TRIAL_S = 60.0  # a file of the largest size takes a few seconds
SUFFIXES = (".h5", ".hdf5")
MISSING = "is HDF5, which needs h5py: pip install 'imocap[h5]', or export the results as CSV"
_UNREADABLE = (OSError, RuntimeError, KeyError, TypeError, ValueError, MemoryError, AttributeError)


def is_hdf5(path: Path) -> bool:
    """By the file's name."""
    return path.suffix.lower() in SUFFIXES


@contextmanager
def open_hdf5(path: Path) -> Iterator[Any]:
    """The file's root group. ValueError, with the path, for all that goes wrong with the file."""
    must_be_file(path)
    must_be_small_enough(path)
    if find_spec("h5py") is None:
        raise ValueError(f"{path}: {MISSING}")
    must_come_back(path, path.stat().st_mtime_ns)
    h5py = import_module("h5py")
    try:
        with h5py.File(path, "r") as root:
            yield root
    except _UNREADABLE as error:
        if str(error).startswith(f"{path}: "):
            raise
        reason = " ".join(str(error).split())[:200]
        raise ValueError(f"{path}: is not readable HDF5 ({reason}); export it again") from None


@cache
def must_come_back(path: Path, changed_ns: int) -> None:
    """ValueError when HDF5's library, in a process of its own, does not finish reading the file, or
    ends that process. What else is wrong with the file is left to be found.

    A file is opened several times, and tried once for each time that it was changed.
    """
    reader = [sys.executable, "-P", "-m", TRIAL, str(path.absolute())]
    try:
        trial = subprocess.run(reader, capture_output=True, timeout=TRIAL_S, check=False)
    except subprocess.TimeoutExpired:
        raise ValueError(
            f"{path}: is damaged: HDF5's library has not finished reading it after "
            f"{TRIAL_S:.0f} s; export it again"
        ) from None
    if trial.returncode not in (0, 1):
        raise ValueError(
            f"{path}: HDF5's library breaks down on it: it is damaged; export it again"
        )


def members(group: Any) -> dict[str, Any]:
    """The datasets and groups that lie in this very group, by name."""
    hard = import_module("h5py").HardLink
    return {name: group[name] for name in group if isinstance(group.get(name, getlink=True), hard)}


def numbers_of(dataset: Any) -> Shaped[np.ndarray, "..."]:
    """A dataset's content; ValueError when it lies in other files, or unpacks to too much."""
    if not hasattr(dataset, "nbytes"):
        raise ValueError("a group where a dataset was expected")
    if dataset.is_virtual or dataset.external:
        raise ValueError("its content is in other files")
    must_unpack_to_little(int(dataset.nbytes))
    return np.asarray(dataset[()])


def words_of(dataset: Any) -> list[str]:
    """A dataset of names."""
    values = numbers_of(dataset).ravel().tolist()
    return [value.decode("utf-8") if isinstance(value, bytes) else str(value) for value in values]
