"""Several real performances of one action: which moments correspond, and one stage for all.

Performances that differ have no measured correspondence; it is defined here by time warping of
their true joints, so that sync errors on them can be read.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from imocap_core.render.arrays import Floats
from imocap_core.sync.warp.dtw import dtw, positions_of_rows
from imocap_core.synthetic.captured import hip_middle, to_stage

SMOOTH_FRAMES = 2.0  # a path on frames is made sub-frame
SKIP_SHARE = 1.0  # of the mean distance: what a frame before or after the common part pays
LEAST_RATE = 0.05  # phase always goes on


@dataclass(frozen=True)
class Performance:
    """joints (T, 14, 3) on the stage, z up; phase (T,) in frames of the first one.

    R_common_from_stage (3, 3), t_common (3,): where poses, not paths, agree best with the first's.
    A performer may face elsewhere on the same path; cameras are compared by what bodies show.
    """

    joints_m: Floats
    phase: Floats
    R_common_from_stage: Floats
    t_common: Floats


def on_one_stage(trials: Sequence[Floats]) -> list[Performance]:
    """Trials (T_v, 14, 3), z up: the first set on the stage, the others onto it (turned about z and
    shifted on the floor) as well as their corresponding frames allow."""
    turn, shift = to_stage(trials[0])
    first = turn.apply(trials[0].reshape(-1, 3)).reshape(trials[0].shape) + shift
    found = [Performance(first, np.arange(len(first), dtype=np.float64), np.eye(3), np.zeros(3))]
    for trial in trials[1:]:
        phase = correspondence(trial, first)
        inside, target = _matched(first, phase)
        turn, shift = _onto(trial[inside], target)
        placed = turn.apply(trial.reshape(-1, 3)).reshape(trial.shape) + shift
        own, other = hip_middle(placed[inside]), hip_middle(target)
        faced, _ = _onto(placed[inside] - own[:, None], target - other[:, None])
        t_common = other.mean(axis=0) - faced.apply(own.mean(axis=0))
        found.append(Performance(placed, phase, faced.as_matrix(), t_common))
    return found


def correspondence(joints_m: Floats, reference_m: Floats) -> Floats:
    """Increasing position (T,) of each frame in the reference, beyond its ends where it shows more.

    Dynamic time warping with open ends over the mean joint distance after a rigid alignment.
    """
    cost = _distances(joints_m, reference_m)
    path, _ = dtw(cost, skip=SKIP_SHARE * float(cost.mean()))
    position = positions_of_rows(path, len(joints_m))
    known = np.flatnonzero(np.isfinite(position))
    every = np.arange(len(position), dtype=np.float64)
    position = np.interp(every, known, position[known])
    position += np.minimum(every - known[0], 0) + np.maximum(every - known[-1], 0)
    ramp = LEAST_RATE * every
    smooth = gaussian_filter1d(position - every, SMOOTH_FRAMES, mode="nearest") + every
    rising: Floats = np.maximum.accumulate(smooth - ramp) + ramp
    return rising


def _distances(a: Floats, b: Floats) -> Floats:
    """(T_a, T_b) mean distance of joints after the best rotation about the middle of the hips."""
    a, b = (x - hip_middle(x)[:, None] for x in (a, b))
    distance = np.empty((len(a), len(b)))
    for row, pose in zip(distance, a, strict=True):
        U, _, Vt = np.linalg.svd(np.einsum("nji,jk->nik", b, pose))
        sign = np.sign(np.linalg.det(U @ Vt))
        U[..., -1] *= sign[:, None]
        turned = np.einsum("nij,kj->nki", U @ Vt, pose)
        row[:] = np.linalg.norm(turned - b, axis=-1).mean(axis=-1)
    return distance


def _matched(reference_m: Floats, phase: Floats) -> tuple[NDArray[np.bool_], Floats]:
    """Which frames lie inside the reference, and the reference's joints there."""
    inside = (phase >= 0) & (phase <= len(reference_m) - 1)
    low = np.minimum(np.floor(phase[inside]).astype(int), len(reference_m) - 2)
    share = (phase[inside] - low)[:, None, None]
    return inside, (1 - share) * reference_m[low] + share * reference_m[low + 1]


def _onto(source_m: Floats, target_m: Floats) -> tuple[Rotation, Floats]:
    """The turn about z and the shift that bring joints (N, 14, 3) closest to the target's."""
    source, target = source_m.reshape(-1, 3), target_m.reshape(-1, 3)
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    sine = (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()
    cosine = (a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1]).sum()
    turn = Rotation.from_rotvec([0.0, 0.0, np.arctan2(sine, cosine)])
    return turn, target.mean(axis=0) - turn.apply(source.mean(axis=0))
