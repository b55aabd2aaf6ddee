"""Matches a whole repetition off: how well a map fits that is shifted to the next repetition.

A walk that begins in another cycle fits nearly as well a cycle later, in every frame alike: no
frame's own evidence reveals it, and the errors of monocular estimates decide between the two.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import minimum_filter1d

DISTINCT = 1.6  # times the distance of the match: a shifted map that fits worse is no alternative
LEAST_S, SLACK_S = 0.4, 0.1  # of a repetition; a shifted match may lie this much beside it
OVERLAP = 0.6  # of the matched frames, that a shifted map must still match


def repetition_evidence(
    squares: Float[np.ndarray, "T S"],
    positions: Float[np.ndarray, " T"],
    matched: Bool[np.ndarray, " T"],
    fps_to: float,
) -> float:
    """Logarithm of DISTINCT over the distance of the best map shifted by a repetition, in units of
    the map's own; 0 where the motion does not repeat.

    Shifted maps count where the distance has first risen to DISTINCT times that of the match: a
    performer who stands still repeats nothing.

    Args:
        squares: squared distances, NaN unknown.
        positions: of the frames in the other video, anything where not matched.
        fps_to: of the other video, in the action's time.
    """
    rows = np.flatnonzero(matched)
    if not len(rows):
        return 0.0
    slack = 2 * round(SLACK_S * fps_to) + 1
    near = minimum_filter1d(np.where(np.isfinite(squares), squares, np.inf), slack, axis=1)
    columns = np.rint(positions[rows]).astype(int)
    evidence = 0.0
    for direction in (1, -1):
        rise = 1.0
        for shift in range(1, squares.shape[1]):
            shifted = columns + direction * shift
            inside = (shifted >= 0) & (shifted < squares.shape[1])
            if inside.mean() < OVERLAP:
                break
            ratio = _ratio(near, rows[inside], columns[inside], shifted[inside])
            if rise >= DISTINCT and shift >= LEAST_S * fps_to:
                evidence = max(evidence, float(np.log(DISTINCT / ratio)))
            rise = max(rise, ratio)
    return evidence


def _ratio(near: np.ndarray, rows: np.ndarray, columns: np.ndarray, shifted: np.ndarray) -> float:
    """Mean distance of the shifted map over that of the map, both where both are known."""
    here, there = near[rows, columns], near[rows, shifted]
    valid = np.isfinite(here) & np.isfinite(there)
    if not valid.any():
        return 1.0
    return float(max(there[valid].mean(), 1e-12) / max(here[valid].mean(), 1e-12))
