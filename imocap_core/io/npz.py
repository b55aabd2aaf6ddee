"""Shared by the npz formats: named arrays, checked; rows selected by frame number."""

from __future__ import annotations

import tokenize
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, Shaped

from imocap_core.limits import must_unpack_to_little

# RuntimeError: raised by zipfile for encrypted files and for unknown kinds of compression.
_UNREADABLE = (
    *(OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error, RuntimeError),
    *(MemoryError, SyntaxError, KeyError, TypeError, OverflowError, tokenize.TokenError),
)


def load_arrays(path: Path) -> dict[str, Shaped[np.ndarray, "..."]]:
    """All arrays of an npz file, or that of an npy file under the name `keypoints`. ValueError when
    it is missing, broken, or contains objects."""
    if not path.is_file():
        raise ValueError(f"{path}: no such file; check its path in action.yaml")
    if path.suffix.lower() == ".npy":
        with _reading(path, "npy"):
            must_unpack_to_little(path.stat().st_size)
            table = np.load(path, mmap_mode="r", allow_pickle=False)  # no larger than the file
            return {"keypoints": np.array(table)}
    if not zipfile.is_zipfile(path):
        raise ValueError(f"{path}: is not a readable npz file; write it again with numpy.savez")
    with _reading(path, "npz"):
        must_unpack_to_little(unpacked_size(path))
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
            return {name: np.asarray(archive[name]) for name in archive.files}


@contextmanager
def _reading(path: Path, kind: str) -> Iterator[None]:
    try:
        yield
    except _UNREADABLE as error:
        raise ValueError(
            f"{path}: is not a readable {kind} file ({str(error)[:200]}); write it again"
        ) from None


def unpacked_size(file: Path | BytesIO) -> int:
    """Bytes that the members of a zip file say they unpack to; no more of them is ever read."""
    with zipfile.ZipFile(file) as archive:
        return sum(member.file_size for member in archive.infolist())


def array_names(path: Path) -> set[str]:
    """The names of an npz file's arrays. ValueError when it is missing or broken."""
    if not path.is_file():
        raise ValueError(f"{path}: no such file; check its path in action.yaml")
    with _reading(path, "npz"), zipfile.ZipFile(path) as archive:
        return {name.removesuffix(".npy") for name in archive.namelist()}


def numbers(
    arrays: dict[str, Shaped[np.ndarray, "..."]], name: str, shape: Sequence[int | str], path: Path
) -> Float[np.ndarray, "..."]:
    """Array ``name`` as float64; ValueError unless its shape matches (text matches any length)."""
    expected = "(" + ", ".join(map(str, shape)) + ")"
    if name not in arrays:
        have = ", ".join(sorted(arrays)) or "nothing"
        raise ValueError(
            f"{path}: {name}: expected an array {expected}, it is missing; has: {have}"
        )
    array = arrays[name]
    if not are_numbers(array, shape):
        raise ValueError(
            f"{path}: {name}: expected numbers of shape {expected}, got {array.dtype} {array.shape}"
        )
    return array.astype(np.float64)


def are_numbers(array: Shaped[np.ndarray, "..."], shape: Sequence[int | str]) -> bool:
    """Whether an array has numbers and this shape (text matches any length)."""
    return (
        array.dtype.kind in "fiu"
        and array.ndim == len(shape)
        and all(isinstance(n, str) or n == m for n, m in zip(shape, array.shape, strict=True))
    )


def names(
    arrays: dict[str, Shaped[np.ndarray, "..."]], name: str, count: int, path: Path
) -> tuple[str, ...]:
    """Array ``name`` as ``count`` strings; ValueError unless it has that many."""
    array = arrays.get(name)
    if array is None or array.shape != (count,) or array.dtype.kind not in "US":
        got = "nothing" if array is None else f"{array.dtype} {array.shape}"
        raise ValueError(f"{path}: {name}: expected {count} names, got {got}")
    return tuple(str(item) for item in array.astype(str))


def rows_for_frames(
    arrays: dict[str, Shaped[np.ndarray, "..."]],
    count: int,
    used: Int[np.ndarray, " T"],
    path: Path,
    name: str = "frames",
) -> Int[np.ndarray, " T"]:
    """Row of each used source frame in arrays of ``count`` rows.

    The file's array ``name`` (count,) gives the source frame of each row. Without it the rows are
    the used frames, when there are as many, or else the frames of the whole video. ValueError when
    a used frame has no row.
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
