"""Matches a whole repetition off: how well a map fits that is shifted to the next repetition.

A walk that begins in another cycle fits nearly as well a cycle later, in every frame alike: no
frame's own evidence reveals it, and the errors of monocular estimates decide between the two.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import minimum_filter1d

DISTINCT = 1.6  # times the distance of the match: a shifted map that fits worse is no alternative
LEAST_S, SLACK_S = 0.4, 0.1  # of a repetition; a shifted match may lie this much beside it
# mean squared distance of a cycle to the next one, over that at the lag where it is largest. By a
# detector's poses of eight real sets: 0.02 to 0.15 of what repeats (skipping a rope, push-ups,
# walking), 0.38 to 0.99 of what does not (throws, strokes, one squat); captured stairs 0.18 to 0.27
RECURRING = 0.3
OVERLAP = 0.6  # of the matched frames, that a shifted map must still match


@dataclass(frozen=True)
class Repetition:
    """The map shifted by a repetition that fits best.

    Attributes:
        shift_frames: of the other video, signed.
        ratio: its mean squared distance over that of the map; below DISTINCT.
    """

    shift_frames: float
    ratio: float

    @property
    def evidence(self) -> float:
        """Logarithm of DISTINCT over the ratio."""
        return float(np.log(DISTINCT / self.ratio))


def next_repetition(
    squares: Float[np.ndarray, "T S"],
    positions: Float[np.ndarray, " T"],
    matched: Bool[np.ndarray, " T"],
    fps_to: float,
) -> Repetition | None:
    """The best map shifted by a repetition; None where the motion does not repeat.

    Shifted maps count where the distance has first risen to DISTINCT times that of the match: a
    performer who stands still repeats nothing.

    Args:
        squares: squared distances, NaN unknown.
        positions: of the frames in the other video, anything where not matched.
        fps_to: of the other video, in the action's time.
    """
    rows = np.flatnonzero(matched)
    if not len(rows):
        return None
    slack = round(SLACK_S * fps_to)
    distance = np.where(np.isfinite(squares), squares, np.inf)
    near = minimum_filter1d(distance, 2 * slack + 1, axis=1)
    columns = np.rint(positions[rows]).astype(int)
    ratios: dict[int, float] = {}
    for direction in (1, -1):
        rise = 1.0
        for shift in range(1, squares.shape[1]):
            ratio = _ratio(near, rows, columns, direction * shift)
            if ratio is None:
                break
            if rise >= DISTINCT and shift >= LEAST_S * fps_to:
                ratios[direction * shift] = ratio
            rise = max(rise, ratio)
    best = min(ratios, key=lambda shift: ratios[shift], default=0)
    if not ratios or ratios[best] >= DISTINCT:
        return None
    beside = [shift for shift in ratios if abs(shift - best) <= 2 * slack]
    exact = min(beside, key=lambda shift: _ratio(distance, rows, columns, shift) or np.inf)
    return Repetition(float(exact), ratios[best])


def repeats(squares: Float[np.ndarray, "T T"], period: float, slack: float) -> bool:
    """Whether a video shows two cycles of about `period` frames, one after the other.

    Args:
        squares: squared distances between its own frames.
        slack: frames by which the period may be wrong.
    """
    lags = range(max(2, round(period - slack)), round(period + slack) + 1)
    return any(_recurrence(squares, lag) <= RECURRING for lag in lags)


def _recurrence(squares: np.ndarray, lag: int) -> float:
    """Of the most alike two successive stretches of `lag` frames, their mean squared distance over
    that at the worst of all smaller lags; infinite where the video is shorter than both."""
    begins = len(squares) - 2 * lag + 1
    if begins < 1:
        return float("inf")
    means = np.stack(
        [
            sliding_window_view(np.diagonal(squares, k), lag).mean(axis=1)[:begins]
            for k in range(1, lag + 1)
        ]
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        ratios = means[-1] / means.max(axis=0)
    return float(np.nanmin(ratios, initial=np.inf))


def _ratio(squares: np.ndarray, rows: np.ndarray, columns: np.ndarray, shift: int) -> float | None:
    """Mean distance of the shifted map over that of the map, both where both are known; None
    where the shifted map leaves the other video."""
    shifted = columns + shift
    inside = (shifted >= 0) & (shifted < squares.shape[1])
    if inside.mean() < OVERLAP:
        return None
    here = squares[rows[inside], columns[inside]]
    there = squares[rows[inside], shifted[inside]]
    valid = np.isfinite(here) & np.isfinite(there)
    if not valid.any():
        return 1.0
    return float(max(there[valid].mean(), 1e-12) / max(here[valid].mean(), 1e-12))
