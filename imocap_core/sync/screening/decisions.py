"""Which videos are mirrored, and which show another action, decided and said in words.

A video is mirrored where the others' common motion explains its keypoints clearly better reflected,
and most videos clearly better as they are taken; where most do not, the action is nearly its own
mirror image, and nothing is decided. Of several at once each has to be so many times as clear. A
video shows another action where its keypoints have a large residual under the others' motion, and
theirs under its own. The clearest is excluded first, and the rest is explained anew. Weak evidence
is reported, never acted on.
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
        score: outlier score; above `LARGEST_SCORE` is another action.
    """

    mirrored: tuple[int, ...]
    outliers: tuple[int, ...]
    margin: Float[np.ndarray, " M"]
    score: Float[np.ndarray, " M"]
    undecided: tuple[int, ...] = ()
    symmetric: bool = False


LARGEST_SCORE = 1.1  # of a video of one action; usual is below 0.9
FEWEST = 3  # of two videos it is undecidable which of them is the other action
# Natural logarithms of residuals, of their ratios, and of what reflection changes (docs/sync.md).
CLEAR_REFLECTION = 0.3  # from which a video is mirrored
DECIDABLE_REFLECTION = (
    0.33  # of the median video, from which an action differs from its mirror image
)
LEAST_ASYMMETRY = 0.13  # share of the spread, of a video and of three quarters of all
ANOTHER_ACTION, DOUBTFUL = -1.0, -1.15  # scores of another action, and worth a remark
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
        score[left] = _scores(members.explained, twins)
        able = [v for v in left if not never_outliers[v]]
        suspect = max(able, key=lambda v: score[v], default=None) if look_outliers else None
        if suspect is None or score[suspect] <= ANOTHER_ACTION:
            break
        if len(left) < FEWEST or len(outliers) >= (M - 1) // 2:
            break
        outliers.append(suspect)
        left.remove(suspect)
        members = _explained(left, videos, twins, pairs, fixed)
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


def _scores(explained: Explanations, twins: Sequence[int]) -> Float[np.ndarray, " L"]:
    """Outlier scores, large where a video and the others explain each other badly.

    The lower of two where left and right may be swapped in a video that would be an outlier.
    """
    scores = _score(explained)
    for video in np.flatnonzero(scores > ANOTHER_ACTION):
        corrected = with_sides_corrected(explained, int(video), twins)
        scores[video] = min(scores[video], _score(corrected)[video])
    return scores


def _score(explained: Explanations) -> Float[np.ndarray, " L"]:
    """Logarithm of the residual, and dissimilarity, less what only the same action has: a clear
    difference from the reflected video, and explained change."""
    residual = np.log(np.maximum(explained.residual, LEAST_RESIDUAL))
    agreement = np.abs(explained.reflected) + np.maximum(explained.change, 0.0)
    return np.asarray(residual + explained.dissimilarity - agreement)
