"""Outliers: videos of another action.

An outlier lies further from the others than they from each other, and either follows their order of
time no better than any other video, or lies far whatever it follows.

By how much a video lies further is the natural logarithm of its residual with the two others that
it fits best, over the median residual of the pairs without it (root mean squares). Videos of one
action have about 0, whatever the estimates' noise and however differently people perform, because
both raise every residual alike. Of the two directions of a pair the better one counts: a short clip
fits into a long one, and not the other way round. A fixed square is added above and below, so that
with precise estimates a performance that differs a little is no outlier.

* By the order of time: the logarithm of the warp residuals, less what the video gains by the
  others' order (`temporal_order.order_gains`), with the two that it gains most with, beyond a fifth
  of what is usual among the others. A bad estimate of the right action lies far from the others
  too, and yet follows them.
* By persistent difference: another action may share the rhythm, as one stroke does with another,
  and then gains much of what the others gain. But its difference persists, where a bad estimate
  errs only at times: so the logarithm of the squares of the persistent differences
  (`persistent_difference`), less an allowance, and less what the video gains beyond what only the
  same action gains.

The score is the exponential of the larger of the two.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

# Chosen on training clips (docs/sync.md). All but a few videos of one action stay below 1.07 there.
LARGEST_SCORE = 1.1
FITTING_SHARE = 0.8  # of the frames; the rest is room for what only one video shows
ORDER_WEIGHT = 5.0
OWED_SHARE = 0.2
PERFORMANCE_M = 0.05  # the fixed part of a warp residual
PERSISTENT_M = 0.1  # the fixed part of a persistent difference
PERSISTENT_EXCESS = 0.35  # allowed of its square (logarithm), whatever is followed
CLEAR_GAIN = 0.4  # a video that gains more by the others' order of time shows their action
CLOSEST = 2  # others that a video is compared with
FEWEST = 3  # of two videos it is undecidable which of them is the other action


def outlier_scores(
    residuals: Float[np.ndarray, "M M"],
    gains: Float[np.ndarray, "M M"],
    persistent: Float[np.ndarray, "M M"],
) -> Float[np.ndarray, " M"]:
    """Scores of videos; NaN for fewer than three, and where nothing is given.

    Args:
        residuals: warp residuals, metres.
        gains: of the order of time.
        persistent: persistent differences, metres.
    """
    M = len(residuals)
    scores = np.full(M, np.nan)
    if M < FEWEST:
        return scores
    follows = _largest_gains(gains)
    for v in range(M):
        owed = OWED_SHARE * float(np.median(np.delete(follows, v)))
        further = _relative_distance(residuals, v, PERFORMANCE_M)
        by_order = further - ORDER_WEIGHT * max(follows[v] - owed, 0.0)
        excess = 2.0 * _relative_distance(persistent, v, PERSISTENT_M) - PERSISTENT_EXCESS
        by_difference = excess - ORDER_WEIGHT * max(follows[v] - CLEAR_GAIN, 0.0)
        scores[v] = np.exp(np.fmax(by_order, by_difference))
    return scores


def _relative_distance(residuals: np.ndarray, v: int, floor: float) -> float:
    """By how much (logarithm) video v lies further from the others than they from each other."""
    better = np.fmin(residuals, residuals.T) ** 2 + floor**2
    of_video = _others(better[v], v)
    rest = np.delete(np.delete(better, v, axis=0), v, axis=1)
    rest = rest[np.isfinite(rest)]
    if not len(of_video) or not len(rest):
        return np.nan
    return 0.5 * float(np.log(np.sort(of_video)[:CLOSEST].mean() / np.median(rest)))


def _largest_gains(gains: np.ndarray) -> np.ndarray:
    """Gain (M,) of each video by the others' order of time; 0 where nothing is given."""
    largest = [np.sort(_others(row, v))[-CLOSEST:] for v, row in enumerate(gains)]
    return np.array([float(g.mean()) if len(g) else 0.0 for g in largest])


def _others(row: np.ndarray, v: int) -> np.ndarray:
    others = np.delete(row, v)
    return np.asarray(others[np.isfinite(others)])


def find_outliers(
    residuals: Float[np.ndarray, "M M"],
    gains: Float[np.ndarray, "M M"],
    persistent: Float[np.ndarray, "M M"],
    never: Bool[np.ndarray, " M"] | None = None,
) -> tuple[list[int], Float[np.ndarray, " M"]]:
    """The videos of another action, in the order of detection, and every video's score.

    The worst is taken out and the rest scored again, until none stands out or no more than half of
    the videos would be left: what most of them show is the action. An outlier's score is the one it
    was taken out by. Arguments as of `outlier_scores`; `never`: videos that must stay.
    """
    most = (len(residuals) - 1) // 2
    left = list(range(len(residuals)))
    scores = np.full(len(residuals), np.nan)
    outliers: list[int] = []
    while True:
        pairs = np.ix_(left, left)
        current = outlier_scores(residuals[pairs], gains[pairs], persistent[pairs])
        scores[left] = current
        able = [k for k, v in enumerate(left) if never is None or not never[v]]
        judged = [k for k in able if np.isfinite(current[k])]
        worst = max(judged, key=lambda k: current[k], default=None)
        if worst is None or current[worst] <= LARGEST_SCORE or len(outliers) == most:
            return outliers, scores
        outliers.append(left.pop(worst))
