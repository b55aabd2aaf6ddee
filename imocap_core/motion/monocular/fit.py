"""The initial SMPL motion of each video by itself (section 3.2, "Initialization").

Each start is refined by minimising the reprojection error with the priors that a single view
needs; the robust loss narrows meanwhile. Of several starts the one of the lowest objective is the
result; all objectives are reported.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool
from torch import Tensor

from imocap_core.motion.kinematics import Body
from imocap_core.motion.monocular.starts import Start, interpolate_rotations
from imocap_core.motion.monocular.upright import balance_terms
from imocap_core.motion.multiview.timeline import sample
from imocap_core.motion.observations import Observation, every, padded, per_video_view, validity
from imocap_core.motion.prior import PosePrior
from imocap_core.motion.solver.gauss_newton import gauss_newton
from imocap_core.motion.solver.objective import objective
from imocap_core.motion.state import MotionState
from imocap_core.motion.terms import (
    FootContact,
    HingeLimits,
    JointAcceleration,
    JointEvidence,
    PathSmoothness,
    PosePriorTerm,
    PoseSmoothness,
    Reprojection,
    ShapePrior,
    Term,
)
from imocap_core.params import FitParams

Progress = Callable[[str], None]
# Scales of the robust loss, relative to the final one, with the tolerance of each: descent may
# pause at the widest; at the others it need not be exact.
COARSE = ((10.0, 3e-3), (3.0, 1e-2), (1.0, 1e-2))
TOLERANCE = 3e-3  # of the fit on all frames, which every later fit improves
BALANCE_ROUNDS = 2  # up and the support are those of the motion before
ESTIMATE_SIGMAS = 3.0  # Geman-McClure scale, in standard deviations of an estimator
PRIOR_FPS = 30.0  # frame rate at which the prior's joint speeds were measured


@dataclass(frozen=True)
class CoarseFits:
    """The fits from all starts of all videos, on every ``stride``-th frame.

    Attributes:
        state: batch of all starts; costs: the objective of each; owner: the video of each.
    """

    state: MotionState
    costs: list[float]
    owner: list[int]
    stride: int

    def rows(self, video: int) -> list[int]:
        """The fits of a video, in the order of its starts."""
        return [row for row, owner in enumerate(self.owner) if owner == video]

    def best_row(self, video: int) -> int:
        """The fit of lowest objective of a video."""
        return min(self.rows(video), key=lambda row: self.costs[row])


@dataclass(frozen=True)
class MonocularFit:
    """The best fit of every video and the objectives of the alternatives.

    Attributes:
        state: batch of all videos; costs: per video, the objective of each start.
        coarse: the fits from all starts.
    """

    state: MotionState
    costs: list[list[float]]
    status: str
    coarse: CoarseFits


def regularisers(body: Body, prior: PosePrior, weights: FitParams, fps: float) -> list[Term]:
    """All terms of the objective that do not depend on the videos, at a frame rate."""
    pace = fps / PRIOR_FPS
    step = prior.velocity_rad.clamp_min(1e-3) / pace
    bend = prior.acceleration_rad.clamp_min(1e-3) / pace**2
    return [
        FootContact(body, (fps / weights.foot_speed_m_s) ** 2, weights.foot_scale),
        PosePriorTerm(prior, weights.pose_prior),
        ShapePrior.of_body(
            body.model, weights.shape_prior, weights.hidden_shape_prior, weights.size_prior
        ),
        JointAcceleration(body, fps, weights.joint_acceleration),
        HingeLimits(weights.limits),
        PoseSmoothness(
            weights.velocity / step**2, weights.acceleration / bend**2, weights.acceleration_scale
        ),
        PathSmoothness(
            (fps / weights.path_velocity_m_s) ** 2, (fps**2 / weights.path_acceleration_m_s2) ** 2
        ),
    ]


def stacked(starts: Sequence[Start], valid: Bool[Tensor, "B T"]) -> MotionState:
    """One batch of starts of different lengths; padding repeats the last frame."""
    longest = valid.shape[1]

    def pad(x: Tensor) -> Tensor:
        return torch.cat([x, x[-1:].expand(longest - len(x), *x.shape[1:])])

    R_local = torch.stack([pad(s.R_local) for s in starts])
    trans = torch.stack([pad(s.trans) for s in starts])
    return MotionState.of(R_local, trans, trans.new_zeros(len(starts), 10), valid)


def evidence_term(
    body: Body, observations: Sequence[Observation], template: Tensor, weights: FitParams
) -> list[Term]:
    """The estimators' joints as a term, if any video has them; template: dtype and device."""
    if all(o.joints is None for o in observations):
        return []
    joints, given = [], []
    for o in observations:
        x = np.full((len(o.xy_px), 24, 3), np.nan) if o.joints is None else o.joints
        finite = np.asarray(np.isfinite(x).all(axis=-1))
        joints.append(np.where(finite[..., None], x, 0.0))
        given.append(finite.astype(float))
    sigma2_m2 = (weights.evidence_mm / 1000) ** 2
    weight = padded(given, template) / sigma2_m2
    return [JointEvidence(body, padded(joints, template), weight, ESTIMATE_SIGMAS)]


def fit_monocular(
    body: Body,
    prior: PosePrior,
    observations: Sequence[Observation],
    starts: Sequence[Sequence[Start]],
    weights: FitParams,
    *,
    stride: int,
    max_steps: int,
    balance: bool = False,
    progress: Progress = lambda _: None,
) -> MonocularFit:
    """Fit every video by itself from each of its starts and return the best fit.

    All starts are fitted on every ``stride``-th frame under a robust loss that narrows; the best of
    each video is then fitted on all frames.

    Args:
        observations: M videos; starts: the starts of each (at least one each).
        max_steps: Gauss-Newton steps of the last fit.
        balance: bodies balance over their support, as no other video tells how far they lean.
    """
    owner = [v for v, of_video in enumerate(starts) for _ in of_video]
    progress(f"{len(owner)} starts on every {stride}th frame")
    coarse = [every(observations[v], stride) for v in owner]
    every_start = [start for of_video in starts for start in of_video]
    flat = [Start(s.R_local[::stride], s.trans[::stride], s.cost) for s in every_start]
    state = stacked(flat, validity(coarse, flat[0].trans))
    fits = CoarseFits(*narrowed(body, prior, coarse, state, weights, COARSE), owner, stride)
    videos = range(len(observations))
    chosen = torch.tensor([fits.best_row(v) for v in videos], device=state.valid.device)
    progress("the best start of each video on all frames")
    state = all_frames(fits.state.rows(chosen), observations, stride)
    terms = monocular_terms(body, prior, observations, state.trans, weights, 1.0)
    for _ in range(BALANCE_ROUNDS):
        balanced = balance_terms(body, state, observations, weights) if balance else []
        solution = gauss_newton(
            [*terms, *balanced], state, max_steps=max_steps, relative_tolerance=TOLERANCE
        )
        state = solution.state
    costs = [[fits.costs[row] for row in fits.rows(v)] for v in videos]
    return MonocularFit(state, costs, solution.status, fits)


def narrowed(
    body: Body,
    prior: PosePrior,
    observations: Sequence[Observation],
    state: MotionState,
    weights: FitParams,
    schedule: Sequence[tuple[float, float]],
) -> tuple[MotionState, list[float]]:
    """Minima under a robust loss that narrows, and the objective of each.

    Args:
        schedule: scales of the loss, relative to the final one, each with its tolerance.
    """
    for scale, tolerance in schedule:
        terms = monocular_terms(body, prior, observations, state.trans, weights, scale)
        state = gauss_newton(terms, state, max_steps=6, relative_tolerance=tolerance).state
    return state, objective(terms, state).tolist()


def monocular_terms(
    body: Body,
    prior: PosePrior,
    observations: Sequence[Observation],
    template: Tensor,
    weights: FitParams,
    scale: float,
) -> list[Term]:
    """The whole objective of single videos.

    Args:
        template: gives dtype and device; scale: of the robust loss, relative to the final one.
    """
    view = per_video_view(observations, template)
    fps = float(np.median([o.fps for o in observations]))
    return [
        Reprojection(body, (view,), weights.robust_scale_sigma * scale),
        *regularisers(body, prior, weights, fps),
        *evidence_term(body, observations, template, weights),
    ]


def all_frames(state: MotionState, observations: Sequence[Observation], stride: int) -> MotionState:
    """A state on every ``stride``-th frame, interpolated to all frames."""
    full = []
    for v, observation in enumerate(observations):
        frames = len(observation.xy_px)
        keys = np.arange(0, frames, stride)
        R, trans = state.R_local[v, : len(keys)], state.trans[v, : len(keys)]
        position = np.minimum(np.arange(frames) / stride, len(keys) - 1)
        full.append(Start(interpolate_rotations(R, keys, frames), sample(trans, position), 0.0))
    dense = stacked(full, validity(observations, state.trans))
    return replace(dense, betas=state.betas)
