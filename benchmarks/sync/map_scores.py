"""Errors of estimated correspondences of a scene of the sync benchmark."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from benchmarks.sync.scenes import SyncScene
from imocap_core.metrics.sync import matched_share, sync_error_frames, sync_error_pct, sync_errors


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
    reference_frame: Sequence[Float[np.ndarray, " T"]],
    confidence: Sequence[Float[np.ndarray, " T"]] | None = None,
) -> SyncScore:
    """Score maps into the video `reference`: fractional frames of it for each video, NaN where
    unmatched."""
    reference_frames = np.arange(len(scene.phases[reference]), dtype=float)
    rows: list[list[float]] = []
    for v, estimate in enumerate(reference_frame):
        if v == reference:
            continue
        errors = sync_errors(
            estimate, scene.phases[v], reference_frames, scene.phases[reference], scene.phase_end
        )
        both = errors.matched & errors.has_truth
        mean_confidence = (
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
                mean_confidence,
            ]
        )
    return SyncScore(*(_mean_of_finite(column) for column in zip(*rows, strict=True)))


def _mean_of_finite(values: Sequence[float]) -> float:
    finite = [v for v in values if np.isfinite(v)]
    return float(np.mean(finite)) if finite else float("nan")


def event_errors_frames(
    scene: SyncScene, reference: int, reference_frame: Sequence[Float[np.ndarray, " T"]]
) -> Float[np.ndarray, " others"]:
    """|a video's event mapped into the reference - the reference's event|, frames, per video other
    than the reference; infinite where the event is unmatched. ValueError for a scene without
    events."""
    if scene.events is None:
        raise ValueError(f"events: expected frames for {scene.name}, got none")
    event = scene.events[reference]
    errors = [
        abs(float(reference_frame[v][frame]) - event)
        for v, frame in enumerate(scene.events)
        if v != reference
    ]
    return np.nan_to_num(np.array(errors), nan=np.inf)


def pair_error_pct(scene: SyncScene, i: int, j: int, positions: Float[np.ndarray, " T"]) -> float:
    """Mean error of a map of video i into video j (fractional frames of it), in % of the motion."""
    frames_j = np.arange(len(scene.phases[j]), dtype=float)
    errors = sync_errors(positions, scene.phases[i], frames_j, scene.phases[j], scene.phase_end)
    return sync_error_pct(errors)
