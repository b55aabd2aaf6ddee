"""Which motion of each video agrees with the other videos, chosen for all videos at once.

The energy of a choice is the mean residual of every video with the others (`agreement`), what each
chosen motion explains its own video worse, and a fixed cost of leaving the motion that does so
best. So the first motions stay unless others agree clearly better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Float

from imocap_core.sync.hypotheses.agreement import pair_costs
from imocap_core.sync.hypotheses.choice import best_labellings
from imocap_core.sync.screening.registration import Keypoints2D

RATE_PER_S = 15.0  # of frames that are compared
MOST_FRAMES = 80  # of the longest video
CHANGE = 0.01  # of taking another motion than the first, in shares of the keypoints' spread
PER_COST, LARGEST_EXCESS = 0.0005, 0.03  # of what it explains its own video worse
TIE = 0.005  # energies nearer to each other than that are not told apart


@dataclass(frozen=True)
class CandidateMotions:
    """One video's keypoints and the motions that may explain them.

    Attributes:
        motions: in the axes of its own camera (y down), the likeliest first.
        keypoints: of the motions' joints, at the same frames.
        excess: objective a frame of each motion, above the first's.
    """

    motions: Sequence[Float[np.ndarray, "T J 3"]]
    keypoints: Keypoints2D
    excess: Float[np.ndarray, " K"]
    fps: float


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
    if len(videos) < 2 or all(len(v.motions) == 1 for v in videos):
        return JointChoice((0,) * len(videos), [() for _ in videos])
    thin = thinned_candidates(videos)
    share = 1.0 / (len(videos) - 1)
    pairs = {
        (a, b): share
        * pair_costs(thin[a].motions, thin[b].motions, thin[a].keypoints, thin[b].keypoints)
        for a, b in combinations(range(len(videos)), 2)
    }
    best, *others = best_labellings([_unary(v.excess) for v in videos], pairs, margin=TIE)
    rivals = [
        tuple(sorted({o.labels[v] for o in others} - {label}))
        for v, label in enumerate(best.labels)
    ]
    return JointChoice(best.labels, rivals)


def thinned_candidates(videos: Sequence[CandidateMotions]) -> list[CandidateMotions]:
    """The same at one frame rate, so that a step of one video is about a step of every other."""
    longest_s = max(len(v.keypoints.weight) / v.fps for v in videos)
    rate = min(RATE_PER_S, MOST_FRAMES / longest_s)
    thin = []
    for video in videos:
        n = max(1, round(video.fps / rate))
        keypoints = Keypoints2D(video.keypoints.xy_px[::n], video.keypoints.weight[::n])
        motions = [x[::n] for x in video.motions]
        thin.append(CandidateMotions(motions, keypoints, video.excess, video.fps / n))
    return thin


def _unary(excess: Float[np.ndarray, " K"]) -> Float[np.ndarray, " K"]:
    """Cost of each motion by itself."""
    worse = np.clip(PER_COST * excess, 0.0, LARGEST_EXCESS)
    return np.where(np.arange(len(excess)) > 0, worse + CHANGE, 0.0)
