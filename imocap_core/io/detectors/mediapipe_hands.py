"""MediaPipe Holistic's hands in an npz: `left_hand_landmarks`, `right_hand_landmarks`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imocap_core.io.npz import array_names, load_arrays, numbers

FIELDS = ("left_hand_landmarks", "right_hand_landmarks")
POINTS = 21
Array = NDArray[np.float64]


def read_mediapipe_hands(
    path: Path, frames: NDArray[np.int64], size: tuple[int, int]
) -> tuple[Array, Array] | None:
    """The hands of the one person that MediaPipe follows.

    Args:
        path: what `read_mediapipe` has read; only an npz has hands: arrays (T, 21, 3), x and y as
            shares of the picture, beside `frames` (T,).
        frames: (T',) source frame numbers that are used.
        size: width and height of the picture.

    Returns:
        Pixels (T', 2, 21, 2) and confidence (T', 2, 21), left hand first, NaN and 0 where there is
        none. MediaPipe says nothing of how sure it is of a point: 1 where there is one. None when
        the file has no hands.

    Raises:
        ValueError: file, field, expected, got.
    """
    if path.suffix != ".npz" or not set(FIELDS) & array_names(path):
        return None
    arrays = load_arrays(path)
    found = np.full((len(frames), 2, POINTS, 2), np.nan)
    for side, name in enumerate(FIELDS):
        if name not in arrays:
            continue
        table = numbers(arrays, name, ("T", POINTS, 3), path)
        rows = np.arange(len(table))
        own = numbers(arrays, "frames", (len(table),), path) if "frames" in arrays else rows
        row_of = {int(frame): row for row, frame in enumerate(own)}
        for t, frame in enumerate(frames.tolist()):
            if frame in row_of:
                found[t, side] = table[row_of[frame], :, :2] * size
    seen = np.isfinite(found).all(axis=-1)
    if not seen.any():
        return None
    return np.where(seen[..., None], found, np.nan), seen.astype(np.float64)
