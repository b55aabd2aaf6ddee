"""How well the common motion of all videos is determined, its cameras and shape free."""

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from imocap_core.motion.monocular.fit import regularisers
from imocap_core.motion.multiview.common import ROBUST_STAGES, spread_m_of, with_spread
from imocap_core.motion.multiview.consensus import Cameras
from imocap_core.motion.multiview.coupled import consensus_motion
from imocap_core.motion.multiview.deviation import Spread
from imocap_core.motion.multiview.rigid_offsets import estimate_strays, first_strays
from imocap_core.motion.multiview.scene import Scene, correlation_frames
from imocap_core.motion.multiview.shared import (
    Evidence,
    estimates_on_axis,
    fit_shared,
    gather,
    views_of,
)
from imocap_core.motion.posterior.noise import Noise
from imocap_core.motion.solver.normal import NormalEquations
from imocap_core.motion.solver.objective import linearise
from imocap_core.motion.solver.selected import factorise
from imocap_core.motion.state import FRAME_UNKNOWNS, POSE, MotionState
from imocap_core.motion.terms import Reprojection, Term
from imocap_core.params import MotionParams
from imocap_core.rotations import hat

STEPS = 2  # of settling on the cameras that are given


@dataclass(frozen=True)
class Common:
    """The common motion at the cameras of a result, and how performances stray from it.

    Attributes:
        motion: batch of 1, world axes, on the reference's frames (N).
        evidence: every video's keypoints there, performances' spread in its weights.
        spread: how far each performance strays; estimates: what estimators' joints say of it.
    """

    motion: MotionState
    cameras: Cameras
    evidence: Evidence
    spread: Spread
    estimates: list[Term]


@dataclass(frozen=True)
class CommonPosterior:
    """Covariance of the common motion's local increments (72 rad, 3 m) and of its globals.

    Attributes:
        common: what it is of; free: videos whose cameras are unknowns, in that order.
        normal: the normal matrix that all this is the inverse of.
        given_globals: (N, 75, 75) covariance of each frame if the globals were known.
        response: (N, 75, m) how the frames follow the globals; globals_: (m, m) their covariance.
    """

    common: Common
    free: list[int]
    normal: NormalEquations
    given_globals: Tensor
    response: Tensor
    globals_: Tensor

    def __len__(self) -> int:
        """N."""
        return len(self.given_globals)

    def seen_by(self, v: int) -> Tensor:
        """(N, 75, 75) covariance of the common motion in the axes of camera ``v``."""
        motion, cameras = self.common.motion, self.common.cameras
        R = cameras.R[v]
        turned = torch.eye(FRAME_UNKNOWNS).to(R)
        turned[POSE:, POSE:] = R
        by_globals = -turned @ self.response
        if v in self.free:
            span = motion.camera_columns(self.free.index(v))
            by_globals[:, :3, span.start : span.start + 3] += (R @ motion.R_local[0, :, 0]).mT
            lever = (motion.trans[0] - motion.pivot()) @ R.T
            eye = torch.eye(3).to(R).expand(len(lever), 3, 3)
            by_globals[:, POSE:, span] += torch.cat([-hat(lever), eye], -1)
        own = turned @ self.given_globals @ turned.T
        return own + by_globals @ self.globals_ @ by_globals.mT


def settle_common(
    scene: Scene, state: MotionState, cameras: Cameras, options: MotionParams
) -> Common:
    """The common motion that goes with a result's motions and cameras, found again.

    A result keeps each video's own motion; the common one starts at their mean and takes a few
    steps with the cameras held.
    """
    weights = scene.weights
    evidence = gather(scene.observations, scene.timeline)
    evidence = replace(evidence, stray=first_strays(len(scene.observations), options))
    motion = consensus_motion(scene, state, cameras, options)
    estimates = estimates_on_axis(
        scene.body, scene.observations, scene.timeline, motion.trans,
        evidence_mm=weights.evidence_mm * correlation_frames(options, scene.fps) ** 0.5,
    )  # fmt: skip
    terms = [*regularisers(scene.body, scene.prior, weights, scene.fps), *estimates]
    few = replace(options, max_steps=STEPS)
    scale = weights.robust_scale_sigma
    motion, _, _ = fit_shared(
        scene.body, motion, evidence, cameras, (), terms, few, robust_scale=scale
    )
    for _ in ROBUST_STAGES:  # as often as the fit does: expectation maximisation is slow
        evidence = estimate_strays(
            scene.body, motion, evidence, cameras, options, robust_scale=scale
        )
    spread_m = spread_m_of(evidence, scene, motion, cameras)
    seen = with_spread(evidence, spread_m, scene, motion, cameras)
    assert evidence.stray is not None
    return Common(motion, cameras, seen, Spread(spread_m, evidence.stray), estimates)


def common_posterior(scene: Scene, common: Common, noise: Noise) -> CommonPosterior:
    """The inverse of the common motion's normal matrix, without damping.

    Args:
        scene: with the priors of a posterior (`Noise.scene`).
    """
    videos, cameras = range(len(scene.observations)), common.cameras
    free = [v for v in videos if v != scene.reference and (common.evidence.weight[v] > 0).any()]
    index = torch.tensor(free, dtype=torch.long, device=common.motion.trans.device)
    state = replace(common.motion, camera_R=cameras.R[index][None], camera_t=cameras.t[index][None])
    views = views_of(common.evidence, cameras, state.trans, free=free)
    image = Reprojection(scene.body, views, scene.weights.robust_scale_sigma)
    terms = [
        *noise.temper([image], scene.fps),
        *common.estimates,  # counted once per correlation time by their own weights
        *regularisers(scene.body, scene.prior, scene.weights, scene.fps),
    ]
    normal = linearise(terms, state)
    factored = factorise(normal.diagonal[0], normal.next1[0], normal.next2[0])
    response = factored.solve(normal.border[0])
    schur = normal.corner[0] - torch.einsum("tni,tnj->ij", normal.border[0], response)
    return CommonPosterior(
        replace(common, motion=state),
        free,
        normal,
        factored.inverse_diagonal(),
        response,
        torch.linalg.inv(schur),
    )
