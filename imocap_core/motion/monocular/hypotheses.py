"""Hypotheses of monocular fits: the distinct motions that may explain one video's keypoints.

One view leaves the sign of every depth open, and the detector's left and right may be swapped.
Starts that match the picture lead to some of the minima; others are reached from the best fit by
reversing the depth of all joints, turning the body by half a turn, or reflecting it in depth with
left and right swapped. Which of them is right the other videos tell (`sync.hypotheses`).
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.monocular.fit import CoarseFits, all_frames, narrowed, stacked
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
DISTINCT_M = 0.1  # mean distance of the joints about the root


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
    observations: Sequence[Observation],
    coarse: CoarseFits,
    weights: FitParams,
    *,
    videos: Sequence[int],
    count: int,
) -> list[list[MotionHypothesis]]:
    """The distinct alternatives of each video's best fit, cheapest first, on all frames.

    Args:
        coarse: the fits from all starts; videos: those whose alternatives are wanted.
        count: alternatives of one video at most. Their costs are less the best fit's.
    """
    thin = [every(o, coarse.stride) for o in observations]
    best = {v: _hypothesis(coarse, coarse.best_row(v), "best", thin[v]) for v in videos}
    reversals = [
        (v, name, start)
        for v in videos
        for name, start in reversed_starts(body, library, best[v].motion, thin[v]).items()
    ]
    reversed_fits = _fits_of(body, prior, [(v, s) for v, _, s in reversals], thin, coarse, weights)
    out: list[list[MotionHypothesis]] = [[] for _ in observations]
    for v in videos:
        rest = [
            _hypothesis(coarse, row, f"start {number}", thin[v])
            for number, row in enumerate(coarse.rows(v), start=1)
            if row != coarse.best_row(v)
        ]
        names = [name for u, name, _ in reversals if u == v]
        rows = zip(reversed_fits.rows(v), names, strict=True)
        rest += [_hypothesis(reversed_fits, row, name, thin[v]) for row, name in rows]
        distinct = _distinct(body, [best[v], *sorted(rest, key=lambda h: h.cost)])[1 : count + 1]
        out[v] = [_dense(h, best[v], observations[v], coarse.stride) for h in distinct]
    return out


def reversed_starts(
    body: Body, library: Library, motion: MotionState, observation: Observation
) -> dict[str, Start]:
    """Starts at the reversals of a motion (batch of 1): its depth, its facing, and its reflection
    in depth with the sides swapped; those that no frame's keypoints can place are left out."""
    R_local = motion.R_local[0]
    joints = _about_root(body, motion).cpu().numpy()
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


def _fits_of(
    body: Body,
    prior: PosePrior,
    starts: Sequence[tuple[int, Start]],
    thin: Sequence[Observation],
    coarse: CoarseFits,
    weights: FitParams,
) -> CoarseFits:
    """The fits from further starts, each given with its video."""
    owner = [v for v, _ in starts]
    if not starts:
        return CoarseFits(coarse.state, [], [], coarse.stride)
    observations = [thin[v] for v in owner]
    state = stacked([s for _, s in starts], validity(observations, starts[0][1].trans))
    state, costs = narrowed(body, prior, observations, state, weights, NARROWING)
    return CoarseFits(state, costs, owner, coarse.stride)


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
        pose = _about_root(body, hypothesis.motion)
        if all(float((pose - p).norm(dim=-1).mean()) > DISTINCT_M for p in poses):
            chosen.append(hypothesis)
            poses.append(pose)
    return chosen


def _about_root(body: Body, motion: MotionState) -> Float[Tensor, "T 24 3"]:
    xyz = body.positions(body.joints, motion)[0]
    return xyz - xyz[:, :1]


def _dense(
    hypothesis: MotionHypothesis, best: MotionHypothesis, observation: Observation, stride: int
) -> MotionHypothesis:
    """On all frames, its cost less the best one's."""
    motion = all_frames(hypothesis.motion, [observation], stride)
    return MotionHypothesis(motion, hypothesis.cost - best.cost, hypothesis.name)
