"""MediaPipe Holistic's hands in an npz: `left_hand_landmarks`, `right_hand_landmarks`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from imocap_core.io.npz import array_names, load_arrays, numbers

FIELDS = ("left_hand_landmarks", "right_hand_landmarks")
POINTS = 21


def read_mediapipe_hands(
    path: Path, frames: Int[np.ndarray, " T"], size: tuple[int, int]
) -> tuple[Float[np.ndarray, "T 2 21 2"], Float[np.ndarray, "T 2 21"]] | None:
    """The hands of the one person that MediaPipe tracks.

    Args:
        path: the file that `read_mediapipe` read; only an npz has hands: arrays (N, 21, 3), x and
            y as shares of the picture, beside `frames` (N,).
        frames: the used source frame numbers.
        size: width and height of the picture.

    Returns:
        Pixels and confidence, left hand first; NaN and 0 where a point is missing. MediaPipe gives
        no confidence of a hand's points: 1 where there is one. None when the file has no hands.

    Raises:
        ValueError: file, field, expected, got.
    """
    if path.suffix != ".npz" or not set(FIELDS) & array_names(path):
        return None
    arrays = load_arrays(path)
    xy_px = np.full((len(frames), 2, POINTS, 2), np.nan)
    for side, name in enumerate(FIELDS):
        if name not in arrays:
            continue
        table = numbers(arrays, name, ("T", POINTS, 3), path)
        rows = np.arange(len(table))
        listed = numbers(arrays, "frames", (len(table),), path) if "frames" in arrays else rows
        row_of = {int(frame): row for row, frame in enumerate(listed)}
        for t, frame in enumerate(frames.tolist()):
            if frame in row_of:
                xy_px[t, side] = table[row_of[frame], :, :2] * size
    visible = np.isfinite(xy_px).all(axis=-1)
    if not visible.any():
        return None
    return np.where(visible[..., None], xy_px, np.nan), visible.astype(np.float64)
