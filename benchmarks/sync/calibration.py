"""Calibration of the confidence: the probability of a match within `sync.confidence_reach_s`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from benchmarks.sync.scenes import SyncScene
from imocap_core.metrics.sync import sync_errors

EDGES = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 1.0)


@dataclass(frozen=True)
class CalibrationRow:
    """Matched frames in a range of confidences: their number, mean confidence, the share within the
    reach, and the median error."""

    confidence: str
    frames: int
    mean_confidence: float
    within: float
    median_s: float


def confidences_and_errors(
    scene: SyncScene,
    reference: int,
    reference_frame: Sequence[Float[np.ndarray, " T"]],
    confidence: Sequence[Float[np.ndarray, " T"]],
) -> Float[np.ndarray, "n 2"]:
    """Confidence and error (seconds of the reference) of all matched frames that have a truth, the
    reference's frames left out."""
    reference_frames = np.arange(len(scene.phases[reference]), dtype=float)
    pairs = [np.zeros((0, 2))]
    for v, frames in enumerate(reference_frame):
        if v != reference:
            errors = sync_errors(
                frames, scene.phases[v], reference_frames, scene.phases[reference], scene.phase_end
            )
            both = errors.matched & errors.has_truth
            error_s = errors.frames[both] / scene.fps[reference]
            pairs.append(np.column_stack([confidence[v][both], error_s]))
    return np.concatenate(pairs)


def calibration(pairs: Float[np.ndarray, "n 2"], reach_s: float) -> list[CalibrationRow]:
    """One row for each range of confidences, and one for all; `pairs` as above."""
    rows = []
    ranges = [*pairwise(EDGES), (EDGES[0], EDGES[-1])]
    for low, high in ranges:
        # the last range includes its upper end
        inside = (pairs[:, 0] >= low) & ((pairs[:, 0] < high) | (high == EDGES[-1]))
        in_range = pairs[inside]
        if len(in_range):
            rows.append(
                CalibrationRow(
                    f"{low:.1f} to {high:.1f}",
                    len(in_range),
                    float(in_range[:, 0].mean()),
                    float(np.mean(in_range[:, 1] <= reach_s)),
                    float(np.median(in_range[:, 1])),
                )
            )
    return rows
