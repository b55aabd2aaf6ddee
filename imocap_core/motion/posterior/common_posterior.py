"""Covariance of the motion common to all videos, its cameras and shape unknown."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from imocap_core.motion.monocular.fit import regularisers
from imocap_core.motion.multiview.cameras import Cameras
from imocap_core.motion.multiview.common_keypoints import (
    CommonKeypoints,
    common_keypoints,
    views_of,
)
from imocap_core.motion.multiview.common_motion import (
    estimate_spread,
    estimate_terms,
    fit_common_motion,
)
from imocap_core.motion.multiview.consensus import consensus_motion
from imocap_core.motion.multiview.deviation import with_keypoint_spread
from imocap_core.motion.multiview.offset_spread import initial_offset_sd
from imocap_core.motion.multiview.scene import DeviationSpread, JointMotion, Scene
from imocap_core.motion.posterior.noise import Noise
from imocap_core.motion.solver.normal import NormalEquations
from imocap_core.motion.solver.objective import linearise
from imocap_core.motion.solver.selected import selected_inverse
from imocap_core.motion.state import FRAME_UNKNOWNS, POSE, MotionState
from imocap_core.motion.terms import Reprojection, Term
from imocap_core.params import MotionParams
from imocap_core.rotations import hat

FIT_STEPS = 2  # of a common motion at the cameras of a result


@dataclass(frozen=True)
class CommonEvidence:
    """A result's common motion and the evidence for it.

    Attributes:
        motion: batch of 1, world axes, at the reference's N frames.
        keypoints: every video's keypoints there, performances' deviations in their weights.
        spread: of the deviations; estimates: monocular estimates as terms.
    """

    motion: MotionState
    cameras: Cameras
    keypoints: CommonKeypoints
    spread: DeviationSpread
    estimates: list[Term]


@dataclass(frozen=True)
class CommonPosterior:
    """Covariance of the common motion's local increments (72 rad, 3 m) and of its globals.

    Attributes:
        evidence: with the globals among the motion's unknowns.
        free: videos whose cameras are unknowns, in that order.
        reference: the video whose camera is the world.
        terms: whose normal matrix at the motion this is the inverse of.
        given_globals: (N, 75, 75) covariance of each frame if the globals were known.
        response: (N, 75, m) how the frames follow the globals; globals_: (m, m) their covariance.
    """

    evidence: CommonEvidence
    free: list[int]
    reference: int
    terms: list[Term]
    given_globals: Float[Tensor, "N 75 75"]
    response: Float[Tensor, "N 75 m"]
    globals_: Float[Tensor, "m m"]

    def __len__(self) -> int:
        """N."""
        return len(self.given_globals)

    def camera_rotation_sd_rad(self, v: int) -> float:
        """Standard deviation of the rotation of camera ``v`` (root of the trace of its covariance):
        0 for the reference, NaN for a video without evidence."""
        if v not in self.free:
            return 0.0 if v == self.reference else float("nan")
        first = self.evidence.motion.camera_columns(self.free.index(v)).start
        variance = self.globals_[first : first + 3, first : first + 3].trace()
        return float(variance.sqrt())

    def in_camera_axes(
        self, v: int, frames: Int[np.ndarray, " P"] | slice = slice(None)
    ) -> Float[Tensor, "P 75 75"]:
        """Covariance of some frames of the common motion in the axes of camera ``v``."""
        motion, cameras = self.evidence.motion, self.evidence.cameras
        given_globals, response = self.given_globals[frames], self.response[frames]
        R = cameras.R[v]
        rotated = torch.eye(FRAME_UNKNOWNS).to(R)
        rotated[POSE:, POSE:] = R
        by_globals = -rotated @ response
        if v in self.free:
            span = motion.camera_columns(self.free.index(v))
            by_globals[:, :3, span.start : span.start + 3] += (R @ motion.R_local[0, frames, 0]).mT
            lever = (motion.trans[0, frames] - motion.pivot()) @ R.T
            eye = torch.eye(3).to(R).expand(len(lever), 3, 3)
            by_globals[:, POSE:, span] += torch.cat([-hat(lever), eye], -1)
        of_frames = rotated @ given_globals @ rotated.T
        return of_frames + by_globals @ self.globals_ @ by_globals.mT


def with_common_motion(scene: Scene, result: JointMotion, options: MotionParams) -> JointMotion:
    """A result with its common motion and spread, fitted at its cameras where it has none."""
    if result.common is not None and result.spread is not None:
        return result
    start = consensus_motion(scene, result.state, result.cameras, options.agreement_rad)
    keypoints = common_keypoints(scene.observations, scene.timeline)
    first = initial_offset_sd(len(scene.observations), options)
    terms = [*regularisers(scene.body, scene.prior, scene.fit, scene.fps)]
    motion, cameras, _ = fit_common_motion(
        scene.body, start, replace(keypoints, offset_sd=first), result.cameras, (),
        [*terms, *estimate_terms(scene, start, options)], FIT_STEPS,
        robust_scale=scene.fit.robust_scale_sigma,
    )  # fmt: skip
    spread = estimate_spread(scene, motion, cameras, options)
    return replace(result, common=motion, spread=spread)


def common_evidence(scene: Scene, result: JointMotion, options: MotionParams) -> CommonEvidence:
    """The evidence for a result's common motion.

    Raises:
        ValueError: the result has no common motion (`with_common_motion` estimates one).
    """
    if result.common is None or result.spread is None:
        raise ValueError("result: expected a common motion and its spread, got none")
    keypoints = common_keypoints(scene.observations, scene.timeline)
    keypoints = replace(keypoints, offset_sd=result.spread.offset_sd)
    weighted = with_keypoint_spread(
        scene.body, keypoints, result.spread.keypoints_m, result.common, result.cameras
    )
    estimates = estimate_terms(scene, result.common, options)
    return CommonEvidence(result.common, result.cameras, weighted, result.spread, estimates)


def common_posterior(scene: Scene, evidence: CommonEvidence, noise: Noise) -> CommonPosterior:
    """The inverse of the common motion's normal matrix, without damping.

    Args:
        scene: with the priors of a posterior (`Noise.scene`).
    """
    videos, cameras = range(len(scene.observations)), evidence.cameras
    free = [v for v in videos if v != scene.reference and (evidence.keypoints.weight[v] > 0).any()]
    motion = evidence.motion
    index = torch.tensor(free, dtype=torch.long, device=motion.trans.device)
    state = replace(motion, camera_R=cameras.R[index][None], camera_t=cameras.t[index][None])
    views = views_of(evidence.keypoints, cameras, state.trans, free=free)
    image = Reprojection(scene.body, views, scene.fit.robust_scale_sigma)
    terms = [
        *noise.temper([image], scene.fps),
        *evidence.estimates,  # counted once per correlation time by their own weights
        *regularisers(scene.body, scene.prior, scene.fit, scene.fps),
    ]
    given_globals, response, schur = _inverse(linearise(terms, state))
    return CommonPosterior(
        replace(evidence, motion=state),
        free,
        scene.reference,
        terms,
        given_globals,
        response,
        torch.linalg.inv(schur),
    )


def _inverse(normal: NormalEquations) -> tuple[Tensor, Tensor, Tensor]:
    """(N, 75, 75) inverse if the globals were known, (N, 75, m) solution for the border, and
    (m, m) information about the globals."""
    diagonal, border = normal.diagonal[0], normal.border[0]
    given_globals, response = torch.empty_like(diagonal), torch.empty_like(border)
    pieces = selected_inverse(diagonal, normal.next1[0], normal.next2[0], lambda t: border[t])
    for piece in pieces:
        given_globals[piece.frames], response[piece.frames] = piece.diagonal, piece.solution
    schur = normal.corner[0] - torch.einsum("tni,tnj->ij", border, response)
    return given_globals, response, schur
