"""Freeze frames: runs of frames with one and the same picture.

A person who stands still is detected a little elsewhere in every frame; in a picture that is shown
again nothing moves at all. All frames of such a run show one moment. To the synchronisation they
are one frame: a second of them is no slow motion, and no thirty observations of one pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from imocap_core.runs import runs

SAME = 2e-4  # of the body's size: less than any detector's errors in two pictures
LEAST_S, LEAST_FRAMES = 0.2, 4  # shorter ones are repeated frames of a converted frame rate


@dataclass(frozen=True)
class DistinctFrames:
    """The distinct pictures of a video of T frames.

    Attributes:
        first, last: of the frames that show each picture.
        picture: which picture each frame shows.
    """

    first: Int[np.ndarray, " D"]
    last: Int[np.ndarray, " D"]
    picture: Int[np.ndarray, " T"]

    @property
    def repeated(self) -> bool:
        """Whether any picture is shown again."""
        return len(self.first) < len(self.picture)

    @property
    def runs(self) -> list[tuple[int, int]]:
        """First and last frame of every freeze frame."""
        again = self.last > self.first
        return list(zip(self.first[again].tolist(), self.last[again].tolist(), strict=True))

    @property
    def times_shown(self) -> Int[np.ndarray, " T"]:
        """How many frames show the picture that each frame shows."""
        return (self.last - self.first + 1)[self.picture]

    def in_frames(self, position: Float[np.ndarray, " N"]) -> Float[np.ndarray, " N"]:
        """Positions among the pictures as positions among the frames; NaN stays NaN. Between two
        pictures, one after the last frame of the earlier one."""
        valid = np.isfinite(position)
        low = np.where(valid, np.floor(position), 0).astype(int)
        beyond = position - low
        frame = np.where(beyond > 0, self.last[low], self.first[low])
        return np.asarray(np.where(valid, frame + beyond, np.nan))


def distinct_frames(frozen: Sequence[tuple[int, int]], length: int) -> DistinctFrames:
    """The pictures of a video whose runs `frozen` (first and last frame) show one each."""
    new = np.ones(length, dtype=bool)
    for begin, end in frozen:
        new[begin + 1 : end + 1] = False
    first = np.flatnonzero(new)
    last = np.append(first[1:] - 1, length - 1) if length else first
    return DistinctFrames(first, last, np.cumsum(new) - 1)


def frozen_runs(
    points: Float[np.ndarray, "T J D"], visible: Bool[np.ndarray, "T J"], fps: float
) -> list[tuple[int, int]]:
    """First and last frame of every freeze frame: the same points, in the same places."""
    if len(points) < 2 or not visible.any():
        return []
    both = visible[1:] & visible[:-1]
    moved = np.where(both[..., None], np.diff(np.nan_to_num(points), axis=0), 0.0)
    square = (moved**2).sum(axis=(1, 2)) / np.maximum(both.sum(axis=1), 1)
    alike = (visible[1:] == visible[:-1]).all(axis=1) & both.any(axis=1)
    same = alike & (np.sqrt(square) < SAME * _size(points, visible))
    least = max(LEAST_FRAMES, round(LEAST_S * fps))
    return [(a, b + 1) for a, b in runs(same, least - 1)]


def _size(points: np.ndarray, visible: np.ndarray) -> float:
    """Diagonal of the box around the visible points, as large as in one frame of ten."""
    low = np.where(visible[..., None], points, np.inf).min(axis=1)
    high = np.where(visible[..., None], points, -np.inf).max(axis=1)
    present = visible.any(axis=1)
    return float(np.quantile(np.linalg.norm(high[present] - low[present], axis=-1), 0.9))
