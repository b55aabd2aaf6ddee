"""Reliability of the confidence on the scenes of `calibration_scenes`: claimed against true shares,
and the expected calibration error."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from benchmarks.sync.calibration_scenes import KINDS, calibration_scenes
from benchmarks.sync.scenes import SyncScene
from imocap_core.metrics.sync import true_reference_frame
from imocap_core.params import SyncParams
from imocap_core.sync import SyncEvidence, SyncResult, synchronise

SURE = 0.9


@dataclass(frozen=True)
class ReliabilityRow:
    """All matched frames of one kind of scene.

    Attributes:
        confidence: mean. right: share within `sync.confidence_reach_s`. error: expected calibration
            error. sure: share of frames said to be 90 % sure; right_of_sure: share of these that
            are right.
    """

    scenes: str
    frames: int
    confidence: float
    right: float
    error: float
    sure: float
    right_of_sure: float


def reliability(file: Path, settings: SyncParams, seed: int) -> list[ReliabilityRow]:
    """One row for each kind of scene, and one of all kinds, each of the same weight."""
    rows, parts = [], []
    for kind in KINDS:
        judged = np.concatenate(
            [judged_frames(scene, settings) for scene in calibration_scenes(file, kind, seed)]
        )
        rows.append(reliability_row(kind, judged))
        parts.append(judged)
    least = min(map(len, parts))
    rng = np.random.default_rng(0)
    every = np.concatenate([p[rng.choice(len(p), least, replace=False)] for p in parts])
    return [*rows, reliability_row("all", every)]


def judged_frames(scene: SyncScene, settings: SyncParams) -> Float[np.ndarray, "n 2"]:
    """Confidence, and 1 where right, of every matched frame of a scene."""
    sync = synchronise(SyncEvidence(scene.poses, scene.fps), settings, np.random.default_rng(0))
    judged = [
        np.column_stack([sync.confidence[v], right])[matched]
        for v in range(len(scene.poses))
        if v != sync.reference
        for right, matched in [right_frames(scene, sync, v, settings.confidence_reach_s)]
    ]
    return np.concatenate(judged)


def right_frames(
    scene: SyncScene, sync: SyncResult, v: int, reach_s: float
) -> tuple[np.ndarray, np.ndarray]:
    """Which frames of video v are matched rightly, and which are matched and can be judged: they
    have a counterpart in the reference, or none anywhere (phase NaN)."""
    r = sync.reference
    clip = np.flatnonzero(np.isfinite(scene.phases[r]))
    true = true_reference_frame(
        np.nan_to_num(scene.phases[v], nan=-1e9), clip, scene.phases[r][clip]
    )
    estimate, nowhere = sync.reference_frame[v], np.isnan(scene.phases[v])
    error_s = np.abs(estimate - true) / scene.fps[r]
    judged = np.isfinite(estimate) & (np.isfinite(true) | nowhere)
    return (error_s <= reach_s) & ~nowhere, judged


def reliability_row(name: str, judged: Float[np.ndarray, "n 2"]) -> ReliabilityRow:
    """The row of frames as of `judged_frames`."""
    confidence, right = judged[:, 0], judged[:, 1] > 0
    sure = confidence >= SURE
    return ReliabilityRow(
        name,
        len(judged),
        float(confidence.mean()),
        float(right.mean()),
        expected_calibration_error(confidence, right),
        float(sure.mean()),
        float(right[sure].mean()) if sure.any() else float("nan"),
    )


def expected_calibration_error(
    confidence: Float[np.ndarray, " n"], right: Bool[np.ndarray, " n"], bins: int = 10
) -> float:
    """Mean over equal bins of |claimed - true share|, weighted by their entries (Naeini et al.,
    2015); at least one entry."""
    bin_ = np.minimum((confidence * bins).astype(int), bins - 1)
    gaps = np.bincount(bin_, weights=confidence - right, minlength=bins)
    return float(np.abs(gaps).sum() / len(confidence))
