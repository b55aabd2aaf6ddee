"""What the npz formats share: named arrays checked at the door, rows picked by frame number."""

from __future__ import annotations

import tokenize
import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

# RuntimeError: what zipfile says of encrypted files and of kinds of compression it does not know.
_UNREADABLE = (
    *(OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error, RuntimeError),
    *(MemoryError, SyntaxError, KeyError, TypeError, tokenize.TokenError),
)


def load_arrays(path: Path) -> dict[str, NDArray]:
    """All arrays of an npz file. ValueError when it is missing, broken, or holds objects."""
    if not path.is_file():
        raise ValueError(f"{path}: there is no such file; check its path in action.yaml")
    if not zipfile.is_zipfile(path):
        raise ValueError(f"{path}: is not a readable npz file; write it again with numpy.savez")
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
            return {name: np.asarray(archive[name]) for name in archive.files}
    except _UNREADABLE as error:
        raise ValueError(f"{path}: is not a readable npz file ({error}); write it again") from None


def array_names(path: Path) -> set[str]:
    """The names of an npz file's arrays. ValueError when it is missing or broken."""
    if not path.is_file():
        raise ValueError(f"{path}: there is no such file; check its path in action.yaml")
    try:
        with zipfile.ZipFile(path) as archive:
            return {name.removesuffix(".npy") for name in archive.namelist()}
    except _UNREADABLE as error:
        raise ValueError(f"{path}: is not a readable npz file ({error}); write it again") from None


def numbers(
    arrays: dict[str, NDArray], name: str, shape: Sequence[int | str], path: Path
) -> NDArray[np.float64]:
    """Array ``name`` as float64; ValueError unless its shape matches (text matches any length)."""
    wanted = "(" + ", ".join(map(str, shape)) + ")"
    if name not in arrays:
        have = ", ".join(sorted(arrays)) or "nothing"
        raise ValueError(f"{path}: {name}: expected an array {wanted}, it is missing; has: {have}")
    array = arrays[name]
    fits = len(array.shape) == len(shape) and all(
        isinstance(want, str) or got == want for got, want in zip(array.shape, shape, strict=True)
    )
    if not fits or array.dtype.kind not in "fiu":
        raise ValueError(
            f"{path}: {name}: expected numbers of shape {wanted}, got {array.dtype} {array.shape}"
        )
    return array.astype(np.float64)


def names(arrays: dict[str, NDArray], name: str, count: int, path: Path) -> tuple[str, ...]:
    """Array ``name`` as ``count`` strings."""
    array = arrays.get(name)
    if array is None or array.shape != (count,) or array.dtype.kind not in "US":
        got = "nothing" if array is None else f"{array.dtype} {array.shape}"
        raise ValueError(f"{path}: {name}: expected {count} names, got {got}")
    return tuple(str(item) for item in array.astype(str))


def rows_for_frames(
    arrays: dict[str, NDArray],
    count: int,
    used: NDArray[np.int64],
    path: Path,
    name: str = "frames",
) -> NDArray[np.int64]:
    """Row (T,) of each used source frame in arrays of ``count`` rows.

    The file's own array ``name`` (count,) says which source frame each row is. Without it the rows
    are the used frames themselves, when there are as many, or else the frames of the whole video.
    """
    if name in arrays:
        listed = numbers(arrays, name, (count,), path).astype(np.int64)
        row_of = {int(frame): row for row, frame in enumerate(listed)}
    elif count == len(used):
        row_of = {int(frame): row for row, frame in enumerate(used)}
    else:
        row_of = {row: row for row in range(count)}
    missing = [int(frame) for frame in used if int(frame) not in row_of]
    if missing:
        raise ValueError(
            f"{path}: expected a row for each of the {len(used)} used frames, got {count} rows and "
            f"none for frame {missing[0]} ({len(missing)} missing); add an array `{name}` "
            "with source frame numbers, or change `frames` in action.yaml"
        )
    return np.array([row_of[int(frame)] for frame in used], dtype=np.int64)
