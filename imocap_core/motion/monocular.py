"""The initial SMPL motion of each video by itself (section 3.2, "Initialization").

Each start is refined by minimising the reprojection error with the priors that a single view
needs; the robust loss narrows as the fit settles. Of several starts the one with the lowest
objective is kept, and by how much it won is reported.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from imocap_core.motion.kinematics import Body
from imocap_core.motion.observations import Observation, own_view, padded, validity
from imocap_core.motion.prior import PosePrior
from imocap_core.motion.solver import gauss_newton, objective
from imocap_core.motion.starts import Start
from imocap_core.motion.state import MotionState
from imocap_core.motion.terms import (
    HingeLimits,
    JointEvidence,
    PathSmoothness,
    PosePriorTerm,
    PoseSmoothness,
    Reprojection,
    ShapePrior,
    Term,
)

PRIOR_FPS = 30.0  # frame rate at which the prior's joint speeds were measured


@dataclass(frozen=True)
class FitWeights:
    """Strengths of the terms (see pipeline.yaml, group ``motion``).

    Attributes:
        noise_share: keypoint noise as a share of the person's size.
        robust_scale: final Geman-McClure scale in standard deviations.
        pose_prior, shape_prior, limits: weights of those terms.
        velocity, acceleration: weight of Eq. 7 and of accelerations, relative to the spread
            that real motion shows.
        path_velocity_m_s, path_acceleration_m_s2: root speeds and accelerations that cost 1.
        evidence_mm: standard deviation of an estimator's joints.
    """

    noise_share: float
    robust_scale: float
    pose_prior: float
    shape_prior: float
    limits: float
    velocity: float
    acceleration: float
    path_velocity_m_s: float
    path_acceleration_m_s2: float
    evidence_mm: float


@dataclass(frozen=True)
class MonocularFit:
    """The chosen fit of every video and what the alternatives cost.

    Attributes:
        state: batch of all videos; costs: per video, the objective of each start.
    """

    state: MotionState
    costs: list[list[float]]
    status: str


def regularisers(prior: PosePrior, weights: FitWeights, fps: float) -> list[Term]:
    """Everything in the objective that does not look at the videos, at a frame rate."""
    pace = fps / PRIOR_FPS
    step = prior.velocity_rad.clamp_min(1e-3) / pace
    bend = prior.acceleration_rad.clamp_min(1e-3) / pace**2
    return [
        PosePriorTerm(prior, weights.pose_prior),
        ShapePrior(weights.shape_prior),
        HingeLimits(weights.limits),
        PoseSmoothness(weights.velocity / step**2, weights.acceleration / bend**2),
        PathSmoothness(
            (fps / weights.path_velocity_m_s) ** 2, (fps**2 / weights.path_acceleration_m_s2) ** 2
        ),
    ]


def stacked(starts: Sequence[Start], valid: Tensor) -> MotionState:
    """One batch of starts of different lengths; padding repeats the last frame."""
    longest = valid.shape[1]

    def pad(x: Tensor) -> Tensor:
        return torch.cat([x, x[-1:].expand(longest - len(x), *x.shape[1:])])

    R_local = torch.stack([pad(s.R_local) for s in starts])
    trans = torch.stack([pad(s.trans) for s in starts])
    return MotionState.of(R_local, trans, trans.new_zeros(len(starts), 10), valid)


def evidence_term(
    body: Body, observations: Sequence[Observation], like: Tensor, weights: FitWeights
) -> list[Term]:
    """The estimators' joints as a term, if any video has them."""
    if all(o.joints is None for o in observations):
        return []
    joints, given = [], []
    for o in observations:
        x = o.joints if o.joints is not None else np.full((len(o.xy_px), 24, 3), np.nan)
        known = np.isfinite(x).all(-1)
        joints.append(np.where(known[..., None], x, 0.0))
        given.append(known.astype(float))
    sigma2_m2 = (weights.evidence_mm / 1000) ** 2
    return [JointEvidence(body, padded(joints, like), padded(given, like) / sigma2_m2, 3.0)]


def fit_monocular(
    body: Body,
    prior: PosePrior,
    observations: Sequence[Observation],
    starts: Sequence[Sequence[Start]],
    weights: FitWeights,
    *,
    max_steps: int,
    progress: Callable[[str], None] = lambda _: None,
) -> MonocularFit:
    """Fit every video by itself from each of its starts; keep the best.

    Args:
        observations: M videos; starts: the starts of each (at least one each).
        max_steps: Gauss-Newton steps at the final robust scale.
    """
    owner = [v for v, own in enumerate(starts) for _ in own]
    flat = [start for own in starts for start in own]
    repeated = [observations[v] for v in owner]
    like = flat[0].trans
    valid = validity(repeated, like)
    state = stacked(flat, valid)
    view = own_view(repeated, like, noise_share=weights.noise_share)
    fps = float(np.median([o.fps for o in observations]))
    fixed = regularisers(prior, weights, fps)
    fixed += evidence_term(body, repeated, like, weights)
    for scale, steps in ((10.0, 6), (3.0, 6), (1.0, max_steps)):
        progress(f"{len(flat)} starts, robust scale {scale:g}x")
        terms = [Reprojection(body, (view,), weights.robust_scale * scale), *fixed]
        solution = gauss_newton(terms, state, max_steps=steps, relative_tolerance=1e-3)
        state = solution.state
    cost = objective(terms, state)
    owners = torch.tensor(owner, device=cost.device)
    chosen, costs = [], []
    for v in range(len(observations)):
        rows = (owners == v).nonzero()[:, 0]
        own = cost[rows]
        chosen.append(int(rows[own.argmin()]))
        costs.append([float(c) for c in own])
    index = torch.tensor(chosen, device=cost.device)
    return MonocularFit(state.rows(index), costs, solution.status)
