"""Scenes whose detections fail in one video: half of its frames wrong, a leg occluded, another
person taken for the performer.

Time runs on meanwhile: each frame has its counterpart, and only the other frames tell where.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d

from benchmarks.sync.scenes import SyncScene
from imocap_core.conventions import EVAL_14

CHANGED = 2  # the video whose detections fail
SPELL_S = (0.1, 0.6)  # length of a stretch of wrong frames
LEG_ERROR_M = {"knee": 0.12, "ankle": 0.2}
LEG_PERSISTENCE_S = 0.5
OCCLUDED = (0.4, 0.8)  # share of the video
SWAPPED = (0.2, 0.5)


def half_wrong(
    scene: SyncScene, strangers: Float[np.ndarray, "S 14 3"], rng: np.random.Generator
) -> SyncScene:
    """The scene with half of one video's frames wrong: in stretches of a few frames the pose is
    any of `strangers`, turned anyhow."""
    x = scene.poses[CHANGED].copy()
    T, fps = len(x), scene.fps[CHANGED]
    wrong = np.zeros(T, dtype=bool)
    while wrong.mean() < 0.5:
        start, length = int(rng.integers(T)), max(2, round(fps * rng.uniform(*SPELL_S)))
        span = slice(start, min(start + length, T))
        pose = strangers[int(rng.integers(len(strangers)))] @ _turn_about_y(
            rng.uniform(0, 2 * np.pi)
        )
        x[span] = pose + 0.02 * rng.normal(size=x[span].shape)
        wrong[span] = True
    return _with_poses(scene, x)


def leg_occluded(scene: SyncScene, rng: np.random.Generator) -> SyncScene:
    """The scene with one leg unobserved through much of one video: its knee and ankle wander."""
    x = scene.poses[CHANGED].copy()
    T, fps = len(x), scene.fps[CHANGED]
    span = _stretch(T, rng.uniform(*OCCLUDED), rng)
    side = ("left", "right")[int(rng.integers(2))]
    for part, size_m in LEG_ERROR_M.items():
        noise = gaussian_filter1d(
            rng.normal(size=(T, 3)), 0.5 * LEG_PERSISTENCE_S * fps, axis=0, mode="wrap"
        )
        x[span, EVAL_14.index(f"{side}_{part}")] += (size_m * noise / noise.std())[span]
    return _with_poses(scene, x)


def person_swapped(
    scene: SyncScene, other: Float[np.ndarray, "S 14 3"], rng: np.random.Generator
) -> SyncScene:
    """The scene with another person, who does something else, in a stretch of one video."""
    x = scene.poses[CHANGED].copy()
    span = _stretch(len(x), rng.uniform(*SWAPPED), rng)
    length = span.stop - span.start
    first = int(rng.integers(max(1, len(other) - length)))
    x[span] = np.resize(other[first : first + length], x[span].shape)
    return _with_poses(scene, x)


def _stretch(T: int, share: float, rng: np.random.Generator) -> slice:
    length = round(share * T)
    start = int(rng.integers(T - length + 1))
    return slice(start, start + length)


def _turn_about_y(angle: float) -> Float[np.ndarray, "3 3"]:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def _with_poses(scene: SyncScene, x: Float[np.ndarray, "T 14 3"]) -> SyncScene:
    poses = list(scene.poses)
    poses[CHANGED] = x
    return replace(scene, poses=poses)
