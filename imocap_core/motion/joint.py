"""SMPL-BA: the motion of every video and all cameras, jointly (Eq. 8).

Two ways behind one parameter. ``paper`` alternates exactly as the paper does: Z and Y by SVD,
poses and paths by Gauss-Newton, cameras by PnP. ``shared`` (default) starts from one such round,
then fits ONE motion to all views' 2D at once and gives each video back as much freedom as its own
image evidence asks for.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from imocap_core.motion.consensus import (
    Cameras,
    agreement,
    align,
    cameras_from_motion,
    pelvis,
    to_world,
)
from imocap_core.motion.coupling import coupling_terms, low_rank_targets, to_own_axes
from imocap_core.motion.deviation import joint_spread_rad, keypoint_spread_m
from imocap_core.motion.kinematics import Body
from imocap_core.motion.monocular import FitWeights, evidence_term, regularisers
from imocap_core.motion.observations import Observation, own_view
from imocap_core.motion.prior import PosePrior
from imocap_core.motion.shared import (
    Evidence,
    depths_m,
    fit_shared,
    gather,
    refine_by_pnp,
    reprojection_errors_px,
)
from imocap_core.motion.solver import gauss_newton
from imocap_core.motion.state import MotionState
from imocap_core.motion.terms import Reprojection, Term
from imocap_core.motion.timeline import Timeline
from imocap_core.rotations import mean as chordal_mean

Progress = Callable[[str], None]


@dataclass(frozen=True)
class JointOptions:
    """How SMPL-BA proceeds (pipeline.yaml, group ``motion``).

    Attributes:
        objective: "shared" or "paper" or "single".
        rank: s of Eq. 4 and 5; rounds: alternations of Eq. 8.
        coupling_rad, coupling_path_m: differences between videos that cost 1 (lambda_r1, r2).
        agreement_rad: a joint further than this from the other videos stops following them.
        correlation_s: deviations between performances are counted once per this time.
        max_steps: Gauss-Newton steps of each solve.
    """

    objective: str
    rank: int
    rounds: int
    coupling_rad: float
    coupling_path_m: float
    agreement_rad: float
    correlation_s: float
    max_steps: int


@dataclass(frozen=True)
class JointMotion:
    """What SMPL-BA returns.

    Attributes:
        state: every video's motion in its own camera's axes (batch of M).
        cameras: from the world, which is the reference's camera axes.
        shared: the motion common to all on the reference's axis (batch of 1), world axes.
        costs: the objective after each solve; status: a sentence.
    """

    state: MotionState
    cameras: Cameras
    shared: MotionState | None
    costs: list[float]
    status: str


@dataclass(frozen=True)
class Scene:
    """Everything that stays fixed while SMPL-BA runs."""

    body: Body
    prior: PosePrior
    observations: Sequence[Observation]
    timeline: Timeline
    confidences: list[np.ndarray]
    reference: int
    weights: FitWeights

    @property
    def fps(self) -> float:
        """Frame rate of the reference."""
        return self.observations[self.reference].fps


def recover_motion(
    scene: Scene, start: MotionState, options: JointOptions, progress: Progress = lambda _: None
) -> JointMotion:
    """SMPL-BA from monocular motions (batch of M, own camera axes) and correspondences."""
    if len(scene.observations) == 1:
        eye, zero = torch.eye(3).to(start.trans)[None], torch.zeros(1, 3).to(start.trans)
        status = "one video: the monocular motion stands"
        return JointMotion(start, Cameras(eye, zero), None, [], status)
    state, costs = one_body(start), []
    cameras = cameras_from_motion(align(scene.body, state, scene.timeline), scene.reference)
    rounds = options.rounds if options.objective == "paper" else 1
    for round_ in range(rounds):
        progress(f"coupled fit {round_ + 1} of {rounds}")
        state, cameras, cost = coupled_round(scene, state, cameras, options, refine=round_ > 0)
        costs.append(cost)
    if options.objective == "paper":
        return JointMotion(state, cameras, None, costs, f"{rounds} alternations of Eq. 8")
    return shared_then_own(scene, state, cameras, options, costs, progress)


def one_body(state: MotionState) -> MotionState:
    """All videos show one performer: everybody starts with the mean shape, depths follow."""
    mean = state.betas.mean(0, keepdim=True)
    return replace(state, betas=mean.expand_as(state.betas).clone())


def fixed_terms(scene: Scene, state: MotionState, scale: float = 1.0) -> list[Term]:
    """Every video's own image evidence and regularisers."""
    weights = scene.weights
    view = own_view(scene.observations, state.trans, noise_share=weights.noise_share)
    return [
        Reprojection(scene.body, (view,), weights.robust_scale * scale),
        *regularisers(scene.prior, weights, scene.fps),
        *evidence_term(scene.body, scene.observations, state.trans, weights),
    ]


def coupled_round(
    scene: Scene, state: MotionState, cameras: Cameras, options: JointOptions, *, refine: bool
) -> tuple[MotionState, Cameras, float]:
    """One alternation of Eq. 8: Z and Y, then poses, then cameras."""
    aligned = align(scene.body, state, scene.timeline)
    world = to_world(aligned, cameras)
    follows = agreement(
        world.R_local, world.weight, scale_rad=options.agreement_rad, smooth_frames=7
    )
    Z, Y = low_rank_targets(aligned, cameras, follows * world.weight[..., None], options.rank)
    targets = to_own_axes(Z, Y, cameras, scene.timeline, scene.confidences, state)
    own_follow = _to_own_time(follows, scene.timeline, state)
    joint_weight = own_follow / options.coupling_rad**2
    path_weight = torch.full_like(targets.trust, options.coupling_path_m**-2)
    terms = fixed_terms(scene, state)
    terms += coupling_terms(scene.body, targets, state, joint_weight, path_weight)
    solution = gauss_newton(
        terms, state, max_steps=options.max_steps, relative_tolerance=1e-3, shared_globals=True
    )
    state = solution.state
    aligned = align(scene.body, state, scene.timeline)
    cameras = cameras_from_motion(aligned, scene.reference)
    if refine:
        evidence = gather(
            scene.observations, scene.timeline, noise_share=scene.weights.noise_share
        )
        shared = consensus_motion(scene, state, cameras, options)
        cameras = refine_by_pnp(
            scene.body, shared, evidence, cameras, scene.reference,
            robust_scale=scene.weights.robust_scale,
        )  # fmt: skip
    return state, cameras, solution.costs[-1]


def consensus_motion(
    scene: Scene, state: MotionState, cameras: Cameras, options: JointOptions
) -> MotionState:
    """The mean motion of all videos on the reference's axis (batch of 1, world axes)."""
    world = to_world(align(scene.body, state, scene.timeline), cameras)
    follows = agreement(
        world.R_local, world.weight, scale_rad=options.agreement_rad, smooth_frames=7
    )
    joint_weight = follows * world.weight[..., None]
    R = chordal_mean(world.R_local, joint_weight)
    path = world.pelvis[scene.reference]
    betas = state.betas.mean(0, keepdim=True)
    rest = scene.body.model.shape(betas).joints_rest[:, 0]
    valid = torch.ones(1, len(path), dtype=torch.bool, device=path.device)
    return MotionState.of(R[None], (path - rest)[None], betas, valid)


def shared_then_own(
    scene: Scene,
    state: MotionState,
    cameras: Cameras,
    options: JointOptions,
    costs: list[float],
    progress: Progress,
) -> JointMotion:
    """One motion for all views, then each video's own deviation from it."""
    weights = scene.weights
    evidence = gather(scene.observations, scene.timeline, noise_share=weights.noise_share)
    shared = consensus_motion(scene, state, cameras, options)
    cameras = refine_by_pnp(
        scene.body, shared, evidence, cameras, scene.reference, robust_scale=3 * weights.robust_scale
    )
    terms = regularisers(scene.prior, weights, scene.fps)
    spread_m = np.zeros(evidence.weight.shape)
    for scale in (3.0, 1.0, 1.0):
        progress(f"shared motion, robust scale {scale:g}x")
        trusted = with_spread(evidence, spread_m, scene, shared, cameras)
        shared, cameras, solution = fit_shared(
            scene.body, shared, trusted, cameras, scene.reference, terms,
            robust_scale=weights.robust_scale * scale, max_steps=options.max_steps,
        )  # fmt: skip
        errors = reprojection_errors_px(scene.body, shared, evidence, cameras)
        depth = depths_m(scene.body, shared, cameras)
        spread_m = keypoint_spread_m(
            errors, evidence.sigma_px, depth, evidence.K[:, 0, 0], window=round(scene.fps / 2)
        )
        costs.append(solution.costs[-1])
    if options.objective == "single":
        own = single_motion(scene, shared, state, cameras)
        return JointMotion(own, cameras, shared, costs, "one motion for all videos")
    state, cost = own_deviations(scene, state, shared, cameras, spread_m, options)
    costs.append(cost)
    return JointMotion(state, cameras, shared, costs, solution.status)


def with_spread(
    evidence: Evidence,
    spread_m: np.ndarray,
    scene: Scene,
    shared: MotionState,
    cameras: Cameras,
) -> Evidence:
    """Evidence whose noise holds how far a performance strays from the common one."""
    depth = depths_m(scene.body, shared, cameras)
    spread_px = spread_m * (evidence.K[:, 0, 0, None] / depth)[..., None]
    sigma2 = evidence.sigma_px[..., None] ** 2
    return replace(evidence, weight=evidence.weight * sigma2 / (sigma2 + spread_px**2))


def own_deviations(
    scene: Scene,
    state: MotionState,
    shared: MotionState,
    cameras: Cameras,
    spread_m: np.ndarray,
    options: JointOptions,
) -> tuple[MotionState, float]:
    """Each video from its own image, drawn to the shared motion as strongly as it follows it."""
    videos = len(scene.observations)
    Z = shared.R_local.expand(videos, -1, -1, -1, -1)
    Y = pelvis(scene.body, shared).expand(videos, -1, -1)
    start = single_motion(scene, shared, state, cameras)
    targets = to_own_axes(Z, Y, cameras, scene.timeline, scene.confidences, start)
    spread = joint_spread_rad(scene.body, shared, spread_m)
    once = max(1.0, options.correlation_s * scene.fps)
    weight_on_axis = torch.as_tensor(1 / (spread**2 * once)).to(state.trans)
    joint_weight = _to_own_time(weight_on_axis, scene.timeline, state)
    path_weight = torch.full_like(targets.trust, options.coupling_path_m**-2 / once)
    terms = fixed_terms(scene, start)
    terms += coupling_terms(scene.body, targets, start, joint_weight, path_weight)
    solution = gauss_newton(
        terms, start, max_steps=options.max_steps, relative_tolerance=1e-3, shared_globals=True
    )
    return solution.state, solution.costs[-1]


def single_motion(
    scene: Scene, shared: MotionState, state: MotionState, cameras: Cameras
) -> MotionState:
    """The shared motion at every matched frame of every video; unmatched frames keep theirs."""
    videos = len(scene.observations)
    Z = shared.R_local.expand(videos, -1, -1, -1, -1)
    Y = pelvis(scene.body, shared).expand(videos, -1, -1)
    targets = to_own_axes(Z, Y, cameras, scene.timeline, scene.confidences, state)
    matched = (targets.trust > 0)[..., None]
    rest = scene.body.model.shape(shared.betas).joints_rest[:, 0]
    return replace(
        state,
        R_local=torch.where(matched[..., None, None], targets.R_local, state.R_local),
        trans=torch.where(matched, targets.pelvis - rest[:, None], state.trans),
        betas=shared.betas.expand_as(state.betas).clone(),
    )


def _to_own_time(on_axis: Tensor, timeline: Timeline, state: MotionState) -> Tensor:
    """(M, N, J) on the reference's axis to (M, T, J) at each video's frames (nearest)."""
    out = on_axis.new_zeros(*state.valid.shape, on_axis.shape[-1])
    for v, at in enumerate(timeline.to_reference):
        known = np.isfinite(at)
        nearest = np.clip(np.nan_to_num(at).round().astype(int), 0, on_axis.shape[1] - 1)
        index = torch.as_tensor(nearest, device=on_axis.device)
        out[v, : len(at)] = on_axis[v, index] * torch.as_tensor(known).to(on_axis)[:, None]
    return out
