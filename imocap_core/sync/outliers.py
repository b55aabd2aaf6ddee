"""Does one video show another action? It lies further from the others than they from each other,
and follows their order of time no better than any other.

Two kinds of evidence, in natural logarithms:

* the video's level with the two others that it fits best, over the median level of the pairs it
  has no part in (root mean squares). Videos of one action have about 0, whatever the estimates'
  noise and however differently people perform, because both raise every level alike. Of the two
  directions of a pair the better one counts: a short clip fits into a long one, and not the other
  way round. A fixed square is added above and below, so that precise estimates don't make an
  outlier of a performance that differs a little;
* less what the video gains by the others' order of time (`order.alignment_gains`), with the two
  that it gains most with, beyond a fifth of what is usual among the others. A bad estimate of the
  right action lies far from the others too, and yet follows them.

The score is the exponential of the sum.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Chosen on training clips with each action left out in turn (docs/sync.md). Videos of one action
# stay below 1.06 there.
LARGEST_SCORE = 1.1
FITTING_SHARE = 0.8  # of the frames; what is left out is room for what only one video shows
ORDER_WEIGHT = 5.0
OWED_SHARE = 0.2
PERFORMANCE_M = 0.05  # the fixed part of a level
CLOSEST = 2  # others that a video is held against
FEWEST = 3  # with two videos nobody can say which of them is the other action


def outlier_scores(levels: Array, gains: Array) -> Array:
    """Scores (M,) of videos with matched levels (M, M) in metres and alignment gains (M, M); NaN
    for fewer than three, and where nothing is known."""
    M = len(levels)
    scores = np.full(M, np.nan)
    if M < FEWEST:
        return scores
    better = np.fmin(levels, levels.T) ** 2 + PERFORMANCE_M**2
    follows = _followed(gains)
    for v in range(M):
        own = _others(better[v], v)
        rest = np.delete(np.delete(better, v, axis=0), v, axis=1)
        rest = rest[np.isfinite(rest)]
        if len(own) and len(rest):
            further = 0.5 * np.log(np.sort(own)[:CLOSEST].mean() / np.median(rest))
            owed = OWED_SHARE * float(np.median(np.delete(follows, v)))
            scores[v] = np.exp(further - ORDER_WEIGHT * max(follows[v] - owed, 0.0))
    return scores


def _followed(gains: Array) -> Array:
    """What each video (M,) gains by the others' order of time; 0 where nothing is known."""
    own = [np.sort(_others(row, v))[-CLOSEST:] for v, row in enumerate(gains)]
    return np.array([float(g.mean()) if len(g) else 0.0 for g in own])


def _others(row: Array, v: int) -> Array:
    others = np.delete(row, v)
    return np.asarray(others[np.isfinite(others)])


def find_outliers(
    levels: Array, gains: Array, kept: NDArray[np.bool_] | None = None
) -> tuple[list[int], Array]:
    """The videos of another action, in the order of finding, and every video's score (M,).

    The worst is taken out and the rest judged again, until none stands out or no more than half of
    the videos would be left: what most of them show is the action. An outlier's score is the one it
    was taken out by; `kept` (M,) marks videos that must stay.
    """
    most = (len(levels) - 1) // 2
    left = list(range(len(levels)))
    scores = np.full(len(levels), np.nan)
    found: list[int] = []
    while True:
        now = outlier_scores(levels[np.ix_(left, left)], gains[np.ix_(left, left)])
        scores[left] = now
        able = [k for k, v in enumerate(left) if kept is None or not kept[v]]
        judged = [k for k in able if np.isfinite(now[k])]
        worst = max(judged, key=lambda k: now[k], default=None)
        if worst is None or now[worst] <= LARGEST_SCORE or len(found) == most:
            return found, scores
        found.append(left.pop(worst))
