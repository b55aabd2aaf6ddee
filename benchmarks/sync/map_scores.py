"""How far found correspondences are from true ones, for a scene of the sync benchmark."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.sync.scenes import SyncScene
from imocap_core.metrics.sync import matched_share, sync_error_frames, sync_error_pct, sync_errors

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class SyncScore:
    """Means over the videos that are not the reference."""

    error_pct: float
    error_frames: float
    matched: float
    within_one: float  # share of matched frames within one frame of the reference
    confidence: float  # mean over matched frames


def score_maps(
    scene: SyncScene,
    reference: int,
    reference_frame: Sequence[Floats],
    confidence: Sequence[Floats] | None = None,
) -> SyncScore:
    """Score maps into the video `reference`, (T_v,) fractional frames of it, NaN = unmatched."""
    at = np.arange(len(scene.phases[reference]), dtype=float)
    rows: list[list[float]] = []
    for v, found in enumerate(reference_frame):
        if v == reference:
            continue
        errors = sync_errors(found, scene.phases[v], at, scene.phases[reference], scene.phase_end)
        both = errors.matched & errors.has_truth
        trust = (
            float("nan")
            if confidence is None or not both.any()
            else float(confidence[v][both].mean())
        )
        near = float(np.mean(errors.frames[both] <= 1.0)) if both.any() else float("nan")
        rows.append(
            [
                sync_error_pct(errors),
                sync_error_frames(errors),
                matched_share(errors),
                near,
                trust,
            ]
        )
    return SyncScore(*(_mean_of_known(column) for column in zip(*rows, strict=True)))


def _mean_of_known(values: Sequence[float]) -> float:
    known = [v for v in values if np.isfinite(v)]
    return float(np.mean(known)) if known else float("nan")


def event_errors_frames(
    scene: SyncScene, reference: int, reference_frame: Sequence[Floats]
) -> Floats:
    """|where a video's event lies in the reference - the reference's event|, frames, per video
    other than the reference; infinite where the event is unmatched."""
    if scene.events is None:
        raise ValueError(f"events: expected frames for {scene.name}, got none")
    event = scene.events[reference]
    found = [
        abs(float(reference_frame[v][frame]) - event)
        for v, frame in enumerate(scene.events)
        if v != reference
    ]
    return np.nan_to_num(np.array(found), nan=np.inf)


def pair_error_pct(scene: SyncScene, i: int, j: int, positions: Floats) -> float:
    """Mean error of a map of video i into video j, (T_i,) fractional frames, in % of the motion."""
    at = np.arange(len(scene.phases[j]), dtype=float)
    errors = sync_errors(positions, scene.phases[i], at, scene.phases[j], scene.phase_end)
    return sync_error_pct(errors)
