"""Hypotheses of monocular fits: the distinct motions that may explain one video's keypoints.

One view leaves the sign of every depth open, and the detector's left and right may be swapped.
Starts that match the picture lead to some of the minima; others are reached from the best fit by
reversing the depth of all joints, turning the body by half a turn, or reflecting it in depth with
left and right swapped. Which of them is right the other videos tell (`sync.hypotheses`).
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from imocap_core.motion.monocular.fit import (
    DISTINCT_M,
    CoarseFits,
    about_root,
    all_frames,
    coarse_fits,
    narrowed,
    stacked,
)
from imocap_core.motion.monocular.starts import (
    Library,
    Start,
    fit_rotations_to_joints,
    start_at_joints,
)
from imocap_core.motion.observations import Observation, every, validity
from imocap_core.motion.prior import PosePrior
from imocap_core.motion.state import REFLECTION, TWINS, Body, MotionState
from imocap_core.params import FitParams

NARROWING = ((3.0, 1e-2), (1.0, 1e-2))  # a wider loss would undo the reversal


@dataclass(frozen=True)
class MotionHypothesis:
    """One motion that may explain a video.

    Attributes:
        motion: batch of 1, in the axes of the video's camera.
        cost: objective a frame; name: of the start that led to it.
    """

    motion: MotionState
    cost: float
    name: str


def alternatives(
    body: Body,
    prior: PosePrior,
    library: Library,
    observation: Observation,
    coarse: CoarseFits,
    weights: FitParams,
    *,
    count: int,
    video: int = 0,
) -> list[MotionHypothesis]:
    """The distinct alternatives of a video's best fit, cheapest first, on all frames.

    Args:
        coarse: the fits from all starts; video: whose alternatives are wanted.
        count: of them at most. Their costs are less the best fit's.
    """
    thin, best_row = every(observation, coarse.stride), coarse.best_row(video)
    best = _hypothesis(coarse, best_row, "best", thin)
    rest = [
        _hypothesis(coarse, row, f"start {number}", thin)
        for number, row in enumerate(coarse.rows(video), start=1)
        if row != best_row
    ]
    starts = reversed_starts(body, library, best.motion, thin)
    if starts:
        views = [thin] * len(starts)
        state = stacked(list(starts.values()), validity(views, best.motion.trans))
        fits = narrowed(body, prior, views, state, weights, NARROWING)
        reversals = CoarseFits(*fits, [video] * len(starts), coarse.stride)
        rest += [_hypothesis(reversals, row, name, thin) for row, name in enumerate(starts)]
    distinct = _distinct(body, [best, *sorted(rest, key=lambda h: h.cost)])[1 : count + 1]
    return [_dense(h, best, observation, coarse.stride) for h in distinct]


def from_starts(
    body: Body,
    prior: PosePrior,
    library: Library,
    observation: Observation,
    starts: Sequence[Start],
    stride: int,
    weights: FitParams,
    *,
    count: int,
) -> list[MotionHypothesis]:
    """The fit of one video of lowest cost from several starts, then its alternatives, all with
    their own costs.

    Args:
        count: of all of them at most.
    """
    fits = coarse_fits(body, prior, [observation], [starts], weights, stride)
    best = _hypothesis(fits, fits.best_row(0), "best", every(observation, stride))
    others = alternatives(body, prior, library, observation, fits, weights, count=count - 1)
    dense = MotionHypothesis(all_frames(best.motion, [observation], stride), best.cost, best.name)
    return [dense, *(replace(h, cost=h.cost + best.cost) for h in others)]


def reversed_starts(
    body: Body, library: Library, motion: MotionState, observation: Observation
) -> dict[str, Start]:
    """Starts at the reversals of a motion (batch of 1): its depth, its facing, and its reflection
    in depth with the sides swapped; those that no frame's keypoints can place are left out."""
    R_local = motion.R_local[0]
    joints = about_root(body, motion)[0].cpu().numpy()
    half_turn = torch.diag(R_local.new_tensor([-1.0, 1.0, -1.0]))
    reflection = torch.diag(torch.as_tensor(REFLECTION).to(R_local))
    turned, reflected = R_local.clone(), reflection @ R_local[:, TWINS] @ reflection
    turned[:, 0], reflected[:, 0] = half_turn @ turned[:, 0], half_turn @ reflected[:, 0]
    rotations = {
        "depth": fit_rotations_to_joints(body, library, joints * np.array([1.0, 1.0, -1.0])),
        "facing": turned,
        "sides": reflected,
    }
    starts = {}
    for name, R in rotations.items():
        with suppress(ValueError):
            starts[name] = start_at_joints(body, R, observation)
    return starts


def _hypothesis(
    fits: CoarseFits, row: int, name: str, observation: Observation
) -> MotionHypothesis:
    frames = len(observation.xy_px)
    return MotionHypothesis(fits.state.of_motion(row, frames), fits.costs[row] / frames, name)


def _distinct(body: Body, ordered: Sequence[MotionHypothesis]) -> list[MotionHypothesis]:
    """Those that lie further than `DISTINCT_M` from all before them."""
    chosen: list[MotionHypothesis] = []
    poses: list[Tensor] = []
    for hypothesis in ordered:
        pose = about_root(body, hypothesis.motion)[0]
        if all(float((pose - p).norm(dim=-1).mean()) > DISTINCT_M for p in poses):
            chosen.append(hypothesis)
            poses.append(pose)
    return chosen


def _dense(
    hypothesis: MotionHypothesis, best: MotionHypothesis, observation: Observation, stride: int
) -> MotionHypothesis:
    """On all frames, its cost less the best one's."""
    motion = all_frames(hypothesis.motion, [observation], stride)
    return MotionHypothesis(motion, hypothesis.cost - best.cost, hypothesis.name)
