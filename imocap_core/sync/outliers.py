"""Does one video show another action? Its matched level against that of the other videos.

A video's score is its level with the two others that it fits best, divided by the median level of
the pairs it has no part in (root mean squares). Videos of one action score about 1, whatever the
estimates' noise and however differently people perform, because both raise every level alike. Of
the two directions of a pair the better one counts: a short clip fits into a long one, and not the
other way round. A fixed square is added above and below, so that precise estimates don't make an
outlier of a performance that differs a little.

A bad estimate of the right action lies far from the others too. It still follows their order of
time, which another action doesn't: a video that fits the others clearly better in order than out
of it (`levels.alignment_gains`) is no outlier, whatever its score.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Calibrated on training clips (docs/sync.md); among three videos one pair is all there is to hold
# against, and a score says less.
LARGEST_SCORE, LARGEST_OF_THREE = 1.065, 1.1
PERFORMANCE_M = 0.14  # the fixed part of a level: about how far performances may differ
LARGEST_GAIN = 0.08  # of a video of another action; calibrated likewise
SHARE_OF_GAIN = 0.25
FEWEST = 3  # with two videos nobody can say which of them is the other action


def outlier_scores(levels: Array) -> Array:
    """Scores (M,) of videos with matched levels (M, M) in metres; NaN for fewer than three."""
    M = len(levels)
    if M < FEWEST:
        return np.full(M, np.nan)
    better = np.fmin(levels, levels.T) ** 2 + PERFORMANCE_M**2
    scores = np.full(M, np.nan)
    for v in range(M):
        own = np.delete(better[v], v)
        rest = np.delete(np.delete(better, v, axis=0), v, axis=1)
        own, rest = own[np.isfinite(own)], rest[np.isfinite(rest)]
        if len(own) and len(rest):
            scores[v] = np.sqrt(np.sort(own)[:2].mean() / np.median(rest))
    return scores


def may_be_outliers(levels: Array) -> bool:
    """Whether any score is too large: only then is it worth asking about order."""
    scores = outlier_scores(levels)
    largest = LARGEST_OF_THREE if len(levels) == FEWEST else LARGEST_SCORE
    return bool((scores[np.isfinite(scores)] > largest).any())


def follow_the_order(gains: Array) -> NDArray[np.bool_]:
    """Which videos (M,) follow the others' order of time, by their alignment gains (M,): the more
    it matters to the others, the more is asked."""
    others = np.array([np.nanmedian(np.delete(gains, v)) for v in range(len(gains))])
    return np.asarray(gains > np.maximum(LARGEST_GAIN, SHARE_OF_GAIN * others))


def find_outliers(levels: Array, kept: NDArray[np.bool_] | None = None) -> tuple[list[int], Array]:
    """The videos of another action, in the order of finding, and every video's score (M,).

    The worst is taken out and the rest judged again, until none stands out or two are left. An
    outlier's score is the one it was taken out by; `kept` (M,) marks videos that must stay.
    """
    left = list(range(len(levels)))
    scores = np.full(len(levels), np.nan)
    found: list[int] = []
    while True:
        now = outlier_scores(levels[np.ix_(left, left)])
        scores[left] = now
        able = [k for k, v in enumerate(left) if kept is None or not kept[v]]
        judged = [k for k in able if np.isfinite(now[k])]
        worst = max(judged, key=lambda k: now[k], default=None)
        largest = LARGEST_OF_THREE if len(left) == FEWEST else LARGEST_SCORE
        if worst is None or now[worst] <= largest:
            return found, scores
        found.append(left.pop(worst))
