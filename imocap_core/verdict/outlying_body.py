"""A body that is far from those of all other videos at the same moment, after the joint solve."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.conventions import EVAL_INDICES, SMPL_JOINTS
from imocap_core.runs import runs

LEAST_DIFFERENCE_M = 0.15  # twice the mean difference between performances of one action
USUAL_RATIO = 2.5  # times the action's median
LEAST_S = 0.3
GAP_S = 0.1
HIPS = [SMPL_JOINTS.index(name) for name in ("left_hip", "right_hip")]


@dataclass(frozen=True)
class PlacedBody:
    """One video's joints (T, 24, 3) in the world's axes, metres, and phases (T,), seconds."""

    joints: Float[np.ndarray, "T 24 3"]
    phase_s: Float[np.ndarray, " T"]
    fps: float


@dataclass(frozen=True)
class Outlying:
    """Frames `first` to `last` (indices, both within), and their mean distance in metres."""

    first: int
    last: int
    distance_m: float


def outlying_bodies(bodies: Mapping[str, PlacedBody]) -> dict[str, list[Outlying]]:
    """Spans in which a video's body is far from the nearest of the others; by video."""
    nearest = nearest_distances(bodies)
    every = np.concatenate(list(nearest.values())) if nearest else np.zeros(0)
    every = every[np.isfinite(every)]
    if not len(every):
        return {video: [] for video in bodies}
    limit = max(LEAST_DIFFERENCE_M, USUAL_RATIO * float(np.median(every)))
    spans = {}
    for video, distance in nearest.items():
        fps = bodies[video].fps
        far = np.nan_to_num(distance) > limit
        spans[video] = [
            Outlying(a, b, float(np.nanmean(distance[a : b + 1])))
            for a, b in runs(far, max(2, round(LEAST_S * fps)), round(GAP_S * fps))
        ]
    return spans


def nearest_distances(bodies: Mapping[str, PlacedBody]) -> dict[str, Float[np.ndarray, " _"]]:
    """Per frame of each video the mean joint distance, root-relative and in the world's axes, to
    the nearest other video at the same moment; NaN where no other shows it."""
    relative = {video: _root_relative(body.joints) for video, body in bodies.items()}
    nearest = {}
    for video, body in bodies.items():
        distance = np.full(len(body.phase_s), np.nan)
        for other, theirs in bodies.items():
            if other != video:
                poses = _at_phase(relative[other], theirs.phase_s, body.phase_s)
                mean = np.linalg.norm(relative[video] - poses, axis=-1).mean(-1)
                distance = np.fmin(distance, mean)
        nearest[video] = distance
    return nearest


def _root_relative(joints: Float[np.ndarray, "T 24 3"]) -> Float[np.ndarray, "T 12 3"]:
    return joints[:, EVAL_INDICES] - joints[:, HIPS].mean(1, keepdims=True)


def _at_phase(
    poses: Float[np.ndarray, "S 12 3"],
    phase_s: Float[np.ndarray, " S"],
    moments_s: Float[np.ndarray, " T"],
) -> Float[np.ndarray, "T 12 3"]:
    """Poses interpolated at moments; NaN outside of what the video shows."""
    placed = np.flatnonzero(np.isfinite(phase_s))
    if not len(placed):
        return np.full((len(moments_s), *poses.shape[1:]), np.nan)
    index = np.interp(moments_s, phase_s[placed], placed, left=np.nan, right=np.nan)
    inside = np.isfinite(index)
    low = np.floor(np.where(inside, index, 0)).astype(int)
    high = np.minimum(low + 1, len(poses) - 1)
    share = (np.where(inside, index, 0) - low)[:, None, None]
    mixed = (1 - share) * poses[low] + share * poses[high]
    return np.where(inside[:, None, None], mixed, np.nan)
