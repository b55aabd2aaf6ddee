"""Scenes of training clips for the calibration of the confidence: plain ones, walks that start in
any cycle, slow motion, a performer who stands still before, frames of another action inside a
video, and detections that fail (`perturbed_scenes`).

In `standing` the performer stands before every video begins, and each video's estimate of that one
pose errs by a pose of its own. In `inserted` the frames of another action have no counterpart
(phase NaN): a match of them is wrong wherever it lies.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from benchmarks.sync_playback import slowed_scene
from benchmarks.sync_scenes import (
    PERFORMED,
    RESAMPLED,
    SyncScene,
    half_wrong,
    leg_occluded,
    performances,
    performed,
    person_swapped,
    resampled,
    training_scenes,
)
from imocap_core.metrics.sync import true_reference_frame
from imocap_core.params import SyncParams
from imocap_core.sync import SyncEvidence, SyncResult, synchronise

KINDS = (
    *("periodic", "performed", "paper", "released", "slow", "standing", "inserted"),
    *("half wrong", "leg occluded", "person swapped"),
)
SLOWER = (8.0, 4.0, 2.0)
STANDING_ERROR_M, JITTER_M = 0.06, 0.01
FADE = 15  # frames in which the error of standing ends
LEAD = 60.0  # phases before the first one
CHANGED = 2  # the video with inserted frames


def calibration_scenes(file: Path, kind: str, seed: int) -> Iterator[SyncScene]:
    """All scenes of a kind; ValueError for an unknown one."""
    if kind not in KINDS:
        raise ValueError(f"kind: expected one of {', '.join(KINDS)}, got {kind!r}")
    if kind in ("paper", "released"):
        yield from (resampled(file, clip, kind, seed) for clip in RESAMPLED)
        return
    if kind == "periodic":
        yield from training_scenes(file, kind, seed)
        return
    for number, clip in enumerate(PERFORMED):
        plain = performed(file, clip, seed)
        rng = np.random.default_rng([seed, number])
        if kind == "slow":
            factor = SLOWER[number % len(SLOWER)]
            yield slowed_scene(f"slow {clip}", performances(file, clip, seed), factor, seed)
        elif kind == "standing":
            yield standing_before(plain, rng)
        elif kind == "performed":
            yield plain
        elif kind == "leg occluded":
            yield leg_occluded(plain, rng)
        else:
            other = performed(file, PERFORMED[(number + 5) % len(PERFORMED)], seed + 1).poses[0]
            yield WITH_OTHERS[kind](plain, other, rng)


def standing_before(scene: SyncScene, rng: np.random.Generator) -> SyncScene:
    """The scene with a performer who first stands in the first pose, another time in each video."""
    poses, phases = [], []
    for x, phase in zip(scene.poses, scene.phases, strict=True):
        frames = int(rng.integers(40, 90))
        error = STANDING_ERROR_M * rng.normal(size=x.shape[1:])
        still = x[:1] + error + JITTER_M * rng.normal(size=(frames, *x.shape[1:]))
        begun = x.copy()
        begun[:FADE] += np.linspace(1, 0, FADE)[:, None, None] * error
        lead = phase[0] - 1 + np.linspace(-LEAD, 0, frames, endpoint=False)
        poses.append(np.concatenate([still, begun]))
        phases.append(np.concatenate([lead, phase]))
    return replace(scene, name=f"standing {scene.name}", poses=poses, phases=phases)


def with_inserted(scene: SyncScene, other: np.ndarray, rng: np.random.Generator) -> SyncScene:
    """The scene with 8 to 30 frames of another action inside one video."""
    poses, phases = list(scene.poses), list(scene.phases)
    x, phase = poses[CHANGED], phases[CHANGED]
    frames = int(rng.integers(8, 30))
    place, start = int(rng.integers(10, len(x) - 10)), int(rng.integers(0, len(other) - frames))
    poses[CHANGED] = np.concatenate([x[:place], other[start : start + frames], x[place:]])
    phases[CHANGED] = np.concatenate([phase[:place], np.full(frames, np.nan), phase[place:]])
    return replace(scene, name=f"inserted {scene.name}", poses=poses, phases=phases)


WITH_OTHERS = {
    "inserted": with_inserted,
    "half wrong": half_wrong,
    "person swapped": person_swapped,
}


# Reliability of the confidence on the scenes of `calibration_scenes`: claimed against true shares,
# and the expected calibration error.

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
