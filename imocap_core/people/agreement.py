"""The performer among several people: whose motion agrees with the people of the other videos.

Used only where a video shows several candidates. Every candidate's 3D poses are compared with those
of the other videos' candidates, independent of time. People who stand still are near each other in
all videos, so it also counts how much nearer the other's poses are than any one of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Float

from imocap_core.conventions import SMPL_JOINTS
from imocap_core.sync.pairwise.procrustes import procrustes_distances

RIVAL_SHARE = 0.4  # of the best score: people with less are not candidates
DISTANCE_SCALE_M = 0.1  # pose distance that outweighs a factor of e in scores
MOTION_WEIGHT = 2.0  # of the log ratio of the distances without and with motion
LEAST_DISTANCE_M = 0.01  # nearer poses are equal
MAX_POSES = 60  # of a candidate
MAX_COMBINATIONS = 4096  # of candidates that are tried exhaustively
JOINTS = [
    k
    for k, name in enumerate(SMPL_JOINTS)
    if any(p in name for p in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle", "head"))
]
LEAST_VISIBILITY = 0.02  # with which a joint that the detector guesses counts


@dataclass(frozen=True)
class SeenMotion:
    """One person's motion in a video, in any axes.

    joints_m: (T, 24, 3). visibility: (T, 24) confidence of the detections that show each joint, 0
    to 1: hidden ones are guessed, otherwise in every video.
    """

    joints_m: Float[np.ndarray, "T 24 3"]
    visibility: Float[np.ndarray, "T 24"]

    def compared(self) -> tuple[Float[np.ndarray, "N J 3"], Float[np.ndarray, "N J"]]:
        """At most `MAX_POSES` poses of the joints that are compared, and their weights."""
        step = max(1, len(self.joints_m) // MAX_POSES)
        weights = np.clip(self.visibility[::step, JOINTS], LEAST_VISIBILITY, 1.0)
        return self.joints_m[::step, JOINTS], weights


def rivals(scores: Sequence[float]) -> list[int]:
    """Rows of the candidates of one video (scores falling): those near the best score."""
    return [row for row, score in enumerate(scores) if score >= RIVAL_SHARE * scores[0]]


def choose_by_agreement(
    scores: Sequence[Sequence[float]], motions: Sequence[Sequence[SeenMotion]]
) -> list[int]:
    """Row of the performer in each video: the combination of candidates that agrees best.

    Args:
        scores: per video, of its candidates (presence x size x motion), positive.
        motions: per video and candidate.

    Returns the combination with the largest sum of log scores and `likeness` of motions.
    """
    videos = len(scores)
    likenesses = {
        (v, w): np.array([[likeness(a, b) for b in motions[w]] for a in motions[v]])
        for v in range(videos)
        for w in range(v + 1, videos)
    }
    log_scores = [np.log(np.array(s) / max(s)) for s in scores]

    def value(rows: Sequence[int]) -> float:
        alike = [likenesses[v, w][rows[v], rows[w]] for v, w in likenesses]
        mean = float(np.mean(alike)) if alike else 0.0
        total = sum(float(log_scores[v][row]) for v, row in enumerate(rows))
        return total + (videos - 1) * mean

    candidates = [range(len(s)) for s in scores]
    if np.prod([len(c) for c in candidates]) <= MAX_COMBINATIONS:
        combinations: list[Sequence[int]] = list(product(*candidates))
        best = max(combinations, key=value)
        return list(best)
    return _coordinate_ascent([0] * videos, candidates, value)


def likeness(a: SeenMotion, b: SeenMotion) -> float:
    """Agreement of two motions, in units of log scores: small distances, and smaller ones than
    without motion."""
    moving, still = pose_set_distances_m(a, b)
    ratio = max(still, LEAST_DISTANCE_M) / max(moving, LEAST_DISTANCE_M)
    return MOTION_WEIGHT * math.log(ratio) - moving / DISTANCE_SCALE_M


def pose_set_distances_m(a: SeenMotion, b: SeenMotion) -> tuple[float, float]:
    """Symmetric mean distance of each pose to the nearest pose of the other set (Chamfer distance),
    and to the one pose of the other set that is the nearest to all.

    Poses are rigidly aligned first, joints weighed by how well both show them; the order of the
    frames does not matter.
    """
    (poses_a, weights_a), (poses_b, weights_b) = a.compared(), b.compared()
    distance = procrustes_distances(poses_a, poses_b, weights_a, weights_b)
    moving = 0.5 * (distance.min(1).mean() + distance.min(0).mean())
    still = 0.5 * (distance.mean(0).min() + distance.mean(1).min())
    return float(moving), float(still)


def _coordinate_ascent(
    rows: list[int], candidates: Sequence[range], value: Callable[[Sequence[int]], float]
) -> list[int]:
    """Each video's best choice given the others', until none changes."""
    while True:
        before = list(rows)
        for v, choices in enumerate(candidates):
            others = list(rows)
            rows[v] = max(choices, key=lambda row: value([*others[:v], row, *others[v + 1 :]]))
        if rows == before:
            return rows
