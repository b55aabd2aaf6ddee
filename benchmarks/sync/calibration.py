"""Is the confidence what it says: the probability of a match within `sync.confidence_reach_s`?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from benchmarks.sync.scenes import SyncScene
from imocap_core.metrics.sync import sync_errors

Floats = NDArray[np.float64]

EDGES = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 1.0)


@dataclass(frozen=True)
class CalibrationRow:
    """Matched frames of a range of confidences: how many, the mean confidence, and the share that
    is within the reach; `median_s` the median error."""

    confidence: str
    frames: int
    said: float
    within: float
    median_s: float


def confidences_and_errors(
    scene: SyncScene,
    reference: int,
    reference_frame: Sequence[Floats],
    confidence: Sequence[Floats],
) -> Floats:
    """Confidence and error in seconds of the reference, (n, 2), of all matched frames whose truth
    is known, the reference's own left out."""
    at = np.arange(len(scene.phases[reference]), dtype=float)
    found = [np.zeros((0, 2))]
    for v, frames in enumerate(reference_frame):
        if v != reference:
            errors = sync_errors(
                frames, scene.phases[v], at, scene.phases[reference], scene.phase_end
            )
            both = errors.matched & errors.has_truth
            off = errors.frames[both] / scene.fps[reference]
            found.append(np.column_stack([confidence[v][both], off]))
    return np.concatenate(found)


def calibration(pairs: Floats, reach_s: float) -> list[CalibrationRow]:
    """One row a range of confidences, and one of all; `pairs` (n, 2) as above."""
    rows = []
    ranges = [*pairwise(EDGES), (EDGES[0], EDGES[-1])]
    for low, high in ranges:
        # the last range holds its upper end
        inside = (pairs[:, 0] >= low) & ((pairs[:, 0] < high) | (high == EDGES[-1]))
        own = pairs[inside]
        if len(own):
            rows.append(
                CalibrationRow(
                    f"{low:.1f} to {high:.1f}",
                    len(own),
                    float(own[:, 0].mean()),
                    float(np.mean(own[:, 1] <= reach_s)),
                    float(np.median(own[:, 1])),
                )
            )
    return rows
