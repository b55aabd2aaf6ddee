"""Captured trials of one action: their correspondence in time, and alignment in one scene.

Different performances have no measured correspondence in time; here it is defined by dynamic time
warping of their true joints, so that synchronisation errors can be measured on them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from benchmarks.synthetic.captured import hip_middle, to_scene
from imocap_core.sync.warp.dtw import dtw, positions_of_rows

SMOOTH_FRAMES = 2.0  # smoothing of the path, for sub-frame positions
SKIP_SHARE = 1.0  # of the mean distance: cost of a frame before or after the common part
LEAST_RATE = 0.05  # of phase: strictly increasing


@dataclass(frozen=True)
class AlignedTrial:
    """A trial in the scene (z up), and its phase in frames of the first trial.

    R_scene_from_capture, t_scene: where the capture's axes lie in the scene.
    R_common_from_scene, t_common: the transform that aligns poses (not paths) best with the first
    trial's. A performer may face elsewhere on the same path, and cameras are evaluated relative to
    the body.
    """

    joints_m: Float[np.ndarray, "T 14 3"]
    phase: Float[np.ndarray, " T"]
    R_scene_from_capture: Float[np.ndarray, "3 3"]
    t_scene: Float[np.ndarray, "3"]
    R_common_from_scene: Float[np.ndarray, "3 3"]
    t_common: Float[np.ndarray, "3"]


def align_trials(trials: Sequence[Float[np.ndarray, "_ 14 3"]]) -> list[AlignedTrial]:
    """Trials (z up) in one scene: the first by `to_scene`, the others aligned with it by a rotation
    about z and a translation, least squares over corresponding frames."""
    turn, shift = to_scene(trials[0])
    first = turn.apply(trials[0].reshape(-1, 3)).reshape(trials[0].shape) + shift
    phase = np.arange(len(first), dtype=np.float64)
    aligned = [AlignedTrial(first, phase, turn.as_matrix(), shift, np.eye(3), np.zeros(3))]
    for trial in trials[1:]:
        phase = correspondence(trial, first)
        inside, target = _matched(first, phase)
        turn, shift = _alignment(trial[inside], target)
        placed = turn.apply(trial.reshape(-1, 3)).reshape(trial.shape) + shift
        path, target_path = hip_middle(placed[inside]), hip_middle(target)
        facing, _ = _alignment(placed[inside] - path[:, None], target - target_path[:, None])
        t_common = target_path.mean(axis=0) - facing.apply(path.mean(axis=0))
        place = (turn.as_matrix(), shift, facing.as_matrix(), t_common)
        aligned.append(AlignedTrial(placed, phase, *place))
    return aligned


def correspondence(
    joints_m: Float[np.ndarray, "T 14 3"], reference_m: Float[np.ndarray, "U 14 3"]
) -> Float[np.ndarray, " T"]:
    """Increasing position of each frame in the reference; extrapolated beyond its ends.

    Dynamic time warping with open ends, by the mean joint distance after rigid alignment.
    """
    cost = _distances(joints_m, reference_m)
    path, _ = dtw(cost, skip=SKIP_SHARE * float(cost.mean()))
    position = positions_of_rows(path, len(joints_m))
    matched = np.flatnonzero(np.isfinite(position))
    every = np.arange(len(position), dtype=np.float64)
    position = np.interp(every, matched, position[matched])
    position += np.minimum(every - matched[0], 0) + np.maximum(every - matched[-1], 0)
    ramp = LEAST_RATE * every
    smooth = gaussian_filter1d(position - every, SMOOTH_FRAMES, mode="nearest") + every
    return np.maximum.accumulate(smooth - ramp) + ramp


def _distances(
    a: Float[np.ndarray, "T 14 3"], b: Float[np.ndarray, "U 14 3"]
) -> Float[np.ndarray, "T U"]:
    """Mean distance of joints after the best rotation about the middle of the hips."""
    a, b = (x - hip_middle(x)[:, None] for x in (a, b))
    distance = np.empty((len(a), len(b)))
    for row, pose in zip(distance, a, strict=True):
        U, _, Vt = np.linalg.svd(np.einsum("nji,jk->nik", b, pose))
        sign = np.sign(np.linalg.det(U @ Vt))
        U[..., -1] *= sign[:, None]
        turned = np.einsum("nij,kj->nki", U @ Vt, pose)
        row[:] = np.linalg.norm(turned - b, axis=-1).mean(axis=-1)
    return distance


def _matched(
    reference_m: Float[np.ndarray, "U 14 3"], phase: Float[np.ndarray, " T"]
) -> tuple[Bool[np.ndarray, " T"], Float[np.ndarray, "N 14 3"]]:
    """Which frames lie inside the reference, and the reference's interpolated joints there."""
    inside = (phase >= 0) & (phase <= len(reference_m) - 1)
    low = np.minimum(np.floor(phase[inside]).astype(int), len(reference_m) - 2)
    share = (phase[inside] - low)[:, None, None]
    return inside, (1 - share) * reference_m[low] + share * reference_m[low + 1]


def _alignment(
    source_m: Float[np.ndarray, "N 14 3"], target_m: Float[np.ndarray, "N 14 3"]
) -> tuple[Rotation, Float[np.ndarray, "3"]]:
    """Least-squares rotation about z and translation of joints onto the target's."""
    source, target = source_m.reshape(-1, 3), target_m.reshape(-1, 3)
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    sine = (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()
    cosine = (a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1]).sum()
    turn = Rotation.from_rotvec([0.0, 0.0, np.arctan2(sine, cosine)])
    return turn, target.mean(axis=0) - turn.apply(source.mean(axis=0))
