"""Which videos are mirrored, and which show another action, decided and said in words.

A video is mirrored where the others' common motion explains its keypoints clearly better reflected,
and most videos clearly better as they are taken; where most do not, the action is nearly its own
mirror image, and nothing is decided. Of several at once each has to be so many times as clear. A
video shows another action where the others' motion explains it no better than a static pose would,
much worse than they explain each other without it, and much less of its change over time than of
theirs: who moves as they do, slower, from another side or badly in places, takes part. The clearest
is decided first, and the rest is explained anew. What is not clear is reported, never acted on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from imocap_core.sync.screening.explanation import (
    LEAST_RESIDUAL,
    Explanations,
    PairResiduals,
    ScreenedVideo,
    explanations,
    likely_signs,
    pair_residuals,
    with_sides_corrected,
)


@dataclass(frozen=True)
class Decisions:
    """Mirrored videos and videos of another action (video indices).

    Attributes:
        mirrored, outliers: detected.
        undecided: look like another action, but the evidence is not clear.
        symmetric: the action is nearly its own mirror image: no video can be called mirrored.
        margin: by how much (logarithm) a video fits the others better reflected; NaN if unknown.
        score: how little the others explain a video; above `LARGEST_SCORE` is another action.
    """

    mirrored: tuple[int, ...]
    outliers: tuple[int, ...]
    margin: Float[np.ndarray, " M"]
    score: Float[np.ndarray, " M"]
    undecided: tuple[int, ...] = ()
    symmetric: bool = False


LARGEST_SCORE = 1.1  # all but a few videos of one action stay below 1.07 (docs/sync.md)
FEWEST = 3  # of two videos it is undecidable which of them is the other action
# Natural logarithms of ratios of residuals, chosen on development scenes (docs/sync.md).
CLEAR_REFLECTION = 0.3  # from which a video is mirrored
DECIDABLE_REFLECTION = (
    0.33  # of the median video, from which an action differs from its mirror image
)
LEAST_ASYMMETRY = 0.13  # share of the spread, of a video and of three quarters of all
ANOTHER_ACTION = 0.18  # score from which a video shows another action
EXCESS_WEIGHT = 0.5  # of the residual over the others', beside that over a static pose
REFLECTION_WEIGHT = 0.5  # of a clear answer to whether it is mirrored, which a stranger has not
SUSPICIOUS, DOUBTFUL = 0.05, 0.14  # first score worth a second look; last score worth a remark
FOLLOWED = 0.4  # of the others' explained change: more is the same action
LEAST_CHANGE = 0.05  # explained, below which nobody is compared
EXPLAINED_OTHERS = -0.1  # the others' median excess over a static pose must lie below
SIGN_ROUNDS = 3


@dataclass(frozen=True)
class _Members:
    """The videos that are left, which of them are taken as mirrored, and their explanations."""

    left: list[int]
    signs: Int[np.ndarray, " L"]
    explained: Explanations


def decide_by_keypoints(
    videos: Sequence[ScreenedVideo],
    twins: Sequence[int],
    pinned: Sequence[bool],
    never_outliers: Bool[np.ndarray, " M"],
    unfit: Sequence[int] = (),
    *,
    look_mirrored: bool,
    look_outliers: bool,
) -> Decisions:
    """Decide on two videos or more besides those that are ``unfit``: outliers from the beginning.

    Args:
        pinned: videos whose reflection is given; never_outliers: videos that stay in any case.
    """
    M = len(videos)
    pairs = pair_residuals(videos, twins)
    fixed = np.asarray(pinned) if look_mirrored else np.ones(M, dtype=bool)
    margin, score = np.full(M, np.nan), np.full(M, np.nan)
    left = [v for v in range(M) if v not in unfit]
    outliers = list(unfit)
    members = _explained(left, videos, twins, pairs, fixed)
    while True:
        margin[left] = members.signs * members.explained.reflected
        score[left] = _scores(members.explained)
        able = [v for v in left if not never_outliers[v]]
        suspect = max(able, key=lambda v: score[v], default=None) if look_outliers else None
        if suspect is None or score[suspect] < SUSPICIOUS or len(left) < FEWEST:
            break
        rest = [v for v in left if v != suspect]
        without = _explained(rest, videos, twins, pairs, fixed)
        score[suspect] = _score_without(
            members.explained, left.index(suspect), without.explained, twins
        )
        if score[suspect] <= ANOTHER_ACTION or len(outliers) >= (M - 1) // 2:
            break
        outliers.append(suspect)
        left, members = rest, without
    mirrored = tuple(v for v, s in zip(left, members.signs, strict=True) if s < 0)
    doubtful = tuple(v for v in left if score[v] > DOUBTFUL) if look_outliers else ()
    return Decisions(
        mirrored=mirrored,
        outliers=tuple(sorted(outliers)),
        undecided=doubtful,
        symmetric=look_mirrored and not _is_decidable(members.explained),
        margin=margin,
        score=LARGEST_SCORE * np.exp(score - ANOTHER_ACTION),
    )


def _explained(
    left: list[int],
    videos: Sequence[ScreenedVideo],
    twins: Sequence[int],
    pairs: PairResiduals,
    pinned: Bool[np.ndarray, " M"],
) -> _Members:
    """The explanations of some videos, mirrored only those of which it is clear."""
    among, members = pairs.among(left), [videos[v] for v in left]
    signs = likely_signs(among, pinned[left])
    explained = explanations(members, twins, among, signs)
    for _ in range(SIGN_ROUNDS):
        better = _clear_signs(signs, explained.reflected, pinned[left])
        if (better == signs).all():
            break
        signs = better
        explained = explanations(members, twins, among, signs)
    flips = signs < 0
    if flips.any() and not (_is_decidable(explained) and _are_clear_together(explained, flips)):
        signs = np.ones_like(signs)
        explained = explanations(members, twins, among, signs)
    return _Members(list(left), signs, explained)


def _clear_signs(
    signs: Int[np.ndarray, " L"], reflected: Float[np.ndarray, " L"], pinned: Bool[np.ndarray, " L"]
) -> Int[np.ndarray, " L"]:
    """The signs, swapped where a video fits clearly better so, -1 only where that is clear."""
    as_given = np.where(pinned, 1, np.where(reflected >= CLEAR_REFLECTION, -signs, signs))
    kept_mirrored = (signs > 0) | (reflected <= -CLEAR_REFLECTION)
    return np.where(kept_mirrored, as_given, 1)


def _is_decidable(explained: Explanations) -> bool:
    """Whether most videos fit clearly better with their signs than in a mirror: by a ratio, which
    noise limits, and by an amount, which a symmetric action does not reach in nearly all videos,
    however precise they are."""
    return bool(
        np.median(-explained.reflected) >= DECIDABLE_REFLECTION
        and np.quantile(-explained.asymmetry, 0.25) >= LEAST_ASYMMETRY
    )


def _are_clear_together(explained: Explanations, flips: Bool[np.ndarray, " L"]) -> bool:
    """Whether videos that fit better reflected are clear as a group: several of them are rare, and
    a walk half a cycle later looks like its mirror image."""
    ratio, amount = -explained.reflected[flips], -explained.asymmetry[flips]
    return bool(
        (ratio >= CLEAR_REFLECTION * flips.sum()).all() and (amount >= LEAST_ASYMMETRY).all()
    )


def _scores(explained: Explanations) -> Float[np.ndarray, " L"]:
    """Each video's score, the others explained with it."""
    scores = []
    for v in range(len(explained.residual)):
        others = np.delete(explained.residual, v), np.delete(explained.change, v)
        scores.append(_score(explained, v, _measures(explained, v), others))
    return np.array(scores)


def _score_without(
    explained: Explanations, video: int, rest: Explanations, twins: Sequence[int]
) -> float:
    """The score of a video, the others explained without it; undecided if these are not clearly.

    Where it would be another action, its left and right may have been swapped by the detector.
    """
    others = rest.residual, rest.change
    score = _score(explained, video, _measures(explained, video), others)
    if score > ANOTHER_ACTION:
        corrected = with_sides_corrected(explained, video, twins)
        score = min(score, _score(explained, video, corrected, others))
    are_explained = np.median(rest.static) <= EXPLAINED_OTHERS
    return score if are_explained else min(score, ANOTHER_ACTION)


def _measures(explained: Explanations, video: int) -> tuple[float, float, float]:
    """A video's residual, the same over a static pose's, and its explained change."""
    residual, static = float(explained.residual[video]), float(explained.static[video])
    return residual, static, float(explained.change[video])


def _score(
    explained: Explanations,
    video: int,
    measures: tuple[float, float, float],
    others: tuple[np.ndarray, np.ndarray],
) -> float:
    """How little the others' motion explains a video, by its poses and by its change over time,
    whichever is less.

    By its poses: its residual over a static pose's and over the others', less what tells whether it
    is mirrored.

    Args:
        measures: as of `_measures`; others: residuals and explained change of the others.
    """
    residual, static, change = measures
    median_residual, median_change = (float(np.median(x)) for x in others)
    excess = np.log(max(residual, LEAST_RESIDUAL) / max(median_residual, LEAST_RESIDUAL))
    mirrored = REFLECTION_WEIGHT * abs(float(explained.reflected[video]))
    followed = max(change, 0.0) / max(median_change, LEAST_CHANGE)
    by_poses = static + EXCESS_WEIGHT * excess - mirrored
    if median_change < LEAST_CHANGE:  # too little changes to be compared
        return float(by_poses)
    return float(min(by_poses, ANOTHER_ACTION + FOLLOWED - followed))
