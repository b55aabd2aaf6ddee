"""Scenes of training clips for the calibration of the confidence: plain ones, walks that start in
any cycle, slow motion, a performer who stands still before, frames of another action inside a
video, and detections that fail (`perturbed_scenes`).

In `standing` the performer stands before every video begins, and each video's estimate of that one
pose errs by a pose of its own. In `inserted` the frames of another action have no counterpart
(phase NaN): a match of them is wrong wherever it lies.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.sync.perturbed_scenes import half_wrong, leg_occluded, person_swapped
from benchmarks.sync.scenes import SyncScene
from benchmarks.sync.slow_motion import slowed_scene
from benchmarks.sync.training_scenes import (
    PERFORMED,
    RESAMPLED,
    performances,
    performed,
    resampled,
    training_scenes,
)

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
