"""The performer among several people: who does what is also done in the other videos.

Only where a video shows somebody else who might be the performer as well. Every candidate's 3D
poses are held against those of the other videos' candidates, whatever the moment.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from imocap_core.conventions import SMPL_JOINTS
from imocap_core.sync.pairwise.affinity import procrustes_distances

Array = NDArray[np.float64]

RIVAL = 0.4  # of the best score: who has less is not thought of
SHARE_M = 0.03  # pose distance that is worth a factor of e in scores
MOST_POSES = 60  # of a candidate
MOST_WAYS = 4096  # combinations of candidates that are all tried
JOINTS = [
    k
    for k, name in enumerate(SMPL_JOINTS)
    if any(p in name for p in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle", "head"))
]


def rivals(scores: Sequence[float]) -> list[int]:
    """Rows of the candidates of one video (scores falling) who may be the performer."""
    return [row for row, score in enumerate(scores) if score >= RIVAL * scores[0]]


def who_performs(scores: Sequence[Sequence[float]], poses: Sequence[Sequence[Array]]) -> list[int]:
    """Row of the performer in each video.

    Args:
        scores: per video, of its candidates (presence x size x motion), positive.
        poses: per video and candidate, joints (T, 24, 3) in metres, any axes.

    Returns the combination with the largest sum of log scores less pose distances in `SHARE_M`.
    """
    videos = len(scores)
    pairs = {
        (v, w): np.array([[set_distance_m(a, b) for b in poses[w]] for a in poses[v]])
        for v in range(videos)
        for w in range(v + 1, videos)
    }
    own = [np.log(np.array(s) / max(s)) for s in scores]

    def worth(rows: Sequence[int]) -> float:
        apart = [pairs[v, w][rows[v], rows[w]] for v, w in pairs]
        mean_apart = float(np.mean(apart)) if apart else 0.0
        mine = sum(float(own[v][row]) for v, row in enumerate(rows))
        return mine - (videos - 1) * mean_apart / SHARE_M

    ways = [range(len(s)) for s in scores]
    if np.prod([len(w) for w in ways]) <= MOST_WAYS:
        every: list[Sequence[int]] = list(product(*ways))
        best = max(every, key=worth)
        return list(best)
    return _one_at_a_time([0] * videos, ways, worth)


def set_distance_m(a: Array, b: Array) -> float:
    """Mean distance of each pose of a (T, 24, 3) to its nearest of b (U, 24, 3), and back.

    Poses are turned onto each other first; the order of the moments does not matter.
    """
    a, b = (x[:: max(1, len(x) // MOST_POSES)][:, JOINTS] for x in (a, b))
    ones = [np.ones(x.shape[:2]) for x in (a, b)]
    apart = procrustes_distances(a, b, *ones)
    return float(0.5 * (apart.min(1).mean() + apart.min(0).mean()))


def _one_at_a_time(
    rows: list[int], ways: Sequence[range], worth: Callable[[Sequence[int]], float]
) -> list[int]:
    """Each video's choice in turn, until none changes."""
    while True:
        before = list(rows)
        for v, own in enumerate(ways):
            others = list(rows)
            rows[v] = max(own, key=lambda row: worth([*others[:v], row, *others[v + 1 :]]))
        if rows == before:
            return rows
