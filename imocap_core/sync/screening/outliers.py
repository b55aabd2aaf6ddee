"""Does one video show another action? It lies further from the others than they from each other,
and either follows their order of time no better than any other, or lies far whatever it follows.

By how much a video lies further is the natural logarithm of its level with the two others that it
fits best, over the median level of the pairs it has no part in (root mean squares). Videos of one
action have about 0, whatever the estimates' noise and however differently people perform, because
both raise every level alike. Of the two directions of a pair the better one counts: a short clip
fits into a long one, and not the other way round. A fixed square is added above and below, so that
precise estimates don't make an outlier of a performance that differs a little.

* By the order of time: that of the matched levels, less what the video gains by the others' order
  (`order.alignment_gains`), with the two that it gains most with, beyond a fifth of what is usual
  among the others. A bad estimate of the right action lies far from the others too, and yet
  follows them.
* For good: another action may share the rhythm, as one stroke does with another, and then gains
  much of what the others gain. But it differs for good where a bad estimate strays now and then:
  so that of the squares of the steady levels (`steady`), less what is allowed, and less what the
  video gains beyond what only the same action does.

The score is the exponential of the larger of the two.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Chosen on training clips (docs/sync.md). All but a few videos of one action stay below 1.07 there.
LARGEST_SCORE = 1.1
FITTING_SHARE = 0.8  # of the frames; what is left out is room for what only one video shows
ORDER_WEIGHT = 5.0
OWED_SHARE = 0.2
PERFORMANCE_M = 0.05  # the fixed part of a level
STEADY_M = 0.1  # the fixed part of a steady level
STEADY_EXCESS = 0.35  # allowed of its square (logarithm) whatever is followed
CLEAR_GAIN = 0.4  # who gains more by the others' order of time shows their action
CLOSEST = 2  # others that a video is held against
FEWEST = 3  # with two videos nobody can say which of them is the other action


def outlier_scores(levels: Array, gains: Array, steady: Array) -> Array:
    """Scores (M,) of videos with matched levels and steady levels (M, M) in metres and alignment
    gains (M, M); NaN for fewer than three, and where nothing is known."""
    M = len(levels)
    scores = np.full(M, np.nan)
    if M < FEWEST:
        return scores
    follows = _followed(gains)
    for v in range(M):
        owed = OWED_SHARE * float(np.median(np.delete(follows, v)))
        by_order = _further(levels, v, PERFORMANCE_M) - ORDER_WEIGHT * max(follows[v] - owed, 0.0)
        excess = 2.0 * _further(steady, v, STEADY_M) - STEADY_EXCESS
        for_good = excess - ORDER_WEIGHT * max(follows[v] - CLEAR_GAIN, 0.0)
        scores[v] = np.exp(np.fmax(by_order, for_good))
    return scores


def _further(levels: Array, v: int, floor: float) -> float:
    """By how much (logarithm) video v lies further from the others than they from each other."""
    better = np.fmin(levels, levels.T) ** 2 + floor**2
    own = _others(better[v], v)
    rest = np.delete(np.delete(better, v, axis=0), v, axis=1)
    rest = rest[np.isfinite(rest)]
    if not len(own) or not len(rest):
        return np.nan
    return 0.5 * float(np.log(np.sort(own)[:CLOSEST].mean() / np.median(rest)))


def _followed(gains: Array) -> Array:
    """What each video (M,) gains by the others' order of time; 0 where nothing is known."""
    own = [np.sort(_others(row, v))[-CLOSEST:] for v, row in enumerate(gains)]
    return np.array([float(g.mean()) if len(g) else 0.0 for g in own])


def _others(row: Array, v: int) -> Array:
    others = np.delete(row, v)
    return np.asarray(others[np.isfinite(others)])


def find_outliers(
    levels: Array, gains: Array, steady: Array, kept: NDArray[np.bool_] | None = None
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
        now = outlier_scores(*(pairs[np.ix_(left, left)] for pairs in (levels, gains, steady)))
        scores[left] = now
        able = [k for k, v in enumerate(left) if kept is None or not kept[v]]
        judged = [k for k in able if np.isfinite(now[k])]
        worst = max(judged, key=lambda k: now[k], default=None)
        if worst is None or now[worst] <= LARGEST_SCORE or len(found) == most:
            return found, scores
        found.append(left.pop(worst))
