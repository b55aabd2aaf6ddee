"""Which motion of each video agrees with the other videos, chosen for all videos at once.

The energy of a choice is the mean residual of every video with the others (`agreement`), what each
chosen motion explains its own video worse, and a fixed cost of leaving the motion that does so
best. So the first motions stay unless others agree clearly better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float

from imocap_core.sync.hypotheses.agreement import Hypothesis3D, pair_costs
from imocap_core.sync.hypotheses.choice import best_labellings
from imocap_core.workers import at_once

RATE_PER_S = 15.0  # of frames that are compared
MOST_FRAMES = 80  # of the longest video
CHANGE = 0.01  # of taking another motion than the first, in shares of the keypoints' spread
PER_COST, LARGEST_EXCESS = 0.0005, 0.03  # of what it explains its own video worse
TIE = 0.005  # energies nearer to each other than that are not told apart


@dataclass(frozen=True)
class CandidateMotions:
    """The motions that may explain one video.

    Attributes:
        hypotheses: the likeliest first.
        excess: objective a frame of each, above the first's.
        suggested: whether the other videos suggested it (`swapped`): taking it costs nothing.
    """

    hypotheses: Sequence[Hypothesis3D]
    excess: Float[np.ndarray, " K"]
    fps: float
    suggested: Bool[np.ndarray, " K"] | None = None


@dataclass(frozen=True)
class JointChoice:
    """The motion chosen for each video.

    Attributes:
        labels: index of the chosen motion of each video.
        rivals: per video, other motions that are part of a joint choice as good.
    """

    labels: tuple[int, ...]
    rivals: list[tuple[int, ...]]


def choose_jointly(videos: Sequence[CandidateMotions]) -> JointChoice:
    """The joint choice of least energy, and the choices that are no worse by `TIE`."""
    if len(videos) < 2 or all(len(v.hypotheses) == 1 for v in videos):
        return JointChoice((0,) * len(videos), [() for _ in videos])
    thin = thinned_candidates(videos)
    share = 1.0 / (len(videos) - 1)
    edges = list(combinations(range(len(videos)), 2))
    costs = at_once(lambda e: pair_costs(thin[e[0]].hypotheses, thin[e[1]].hypotheses), edges)
    pairs = {edge: share * cost for edge, cost in zip(edges, costs, strict=True)}
    best, *others = best_labellings([_unary(v) for v in videos], pairs, margin=TIE)
    rivals = [
        tuple(sorted({o.labels[v] for o in others} - {label}))
        for v, label in enumerate(best.labels)
    ]
    return JointChoice(best.labels, rivals)


def thinned_candidates(videos: Sequence[CandidateMotions]) -> list[CandidateMotions]:
    """The same at one frame rate, so that a step of one video is about a step of every other."""
    return [
        replace(v, hypotheses=_every(v.hypotheses, n), fps=v.fps / n)
        for v, n in zip(videos, strides(videos), strict=True)
    ]


def strides(videos: Sequence[CandidateMotions]) -> list[int]:
    """Frames from one that is compared to the next, of each video."""
    longest_s = max(len(v.hypotheses[0].motion) / v.fps for v in videos)
    rate = min(RATE_PER_S, MOST_FRAMES / longest_s)
    return [max(1, round(v.fps / rate)) for v in videos]


def _every(hypotheses: Sequence[Hypothesis3D], n: int) -> list[Hypothesis3D]:
    """Every n-th frame; keypoints that are shared stay shared."""
    thin = {id(h.keypoints): h.every(n).keypoints for h in hypotheses}
    return [Hypothesis3D(h.motion[::n], thin[id(h.keypoints)]) for h in hypotheses]


def _unary(video: CandidateMotions) -> Float[np.ndarray, " K"]:
    """Cost of each motion by itself."""
    worse = np.clip(PER_COST * video.excess, -LARGEST_EXCESS, LARGEST_EXCESS)
    suggested = np.zeros(len(worse), dtype=bool) if video.suggested is None else video.suggested
    return np.where(np.arange(len(worse)) > 0, worse + CHANGE * ~suggested, 0.0)
