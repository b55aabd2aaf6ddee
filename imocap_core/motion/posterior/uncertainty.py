"""How far each joint may be from where it is said to be, in every frame of every video.

The model behind the result: a common motion z, and each performance ``x_v = z + d_v`` with a
deviation of known spread. By the law of total covariance, in the linear Gaussian case exactly,

    Cov(x_v) = Cov(x_v | z) + G_v Cov(z) G_v^T,

the inverse of the own fit's normal matrix with the common motion given, plus the common motion's
covariance (every view's images, cameras and shape unknown, `common_posterior`) carried through by
the gain ``G_v``: how far the own motion follows when the common one is displaced for long. Joints
follow by the kinematic Jacobian, the body's shape included (`own_posterior`).

Neglected: that an error of the common motion changes within the reach of G (which overstates what
is carried), wrong correspondences beyond the spread they leave in the images, focal lengths and
lens, the body model's own misfit, and everything not Gaussian: a limb on the wrong side of a
depth flip, or taken for its twin, is not covered by any of these numbers.
"""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from imocap_core.motion.multiview.consensus import Cameras
from imocap_core.motion.multiview.scene import Scene
from imocap_core.motion.posterior.common_posterior import (
    CommonPosterior,
    common_posterior,
    settle_common,
)
from imocap_core.motion.posterior.joint_covariance import JointClaim, joint_claim
from imocap_core.motion.posterior.noise import Noise
from imocap_core.motion.posterior.per_video_posterior import own_fits, own_posterior
from imocap_core.motion.solver.normal import NormalEquations
from imocap_core.motion.state import MotionState
from imocap_core.params import MotionParams
from imocap_core.workers import at_once

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Uncertainty:
    """What the posterior of a result says.

    Attributes:
        covariances_m2: per video (T_v, 24, 3, 3), the video's camera axes, joints about the middle
            of the hips; NaN where the normal matrix was not positive definite.
        motion: the motion seen by all videos (batch of 1, world axes; a single video's own).
        normal: its normal matrix; common: None for one video.
    """

    covariances_m2: list[Array]
    motion: MotionState
    normal: NormalEquations
    common: CommonPosterior | None


def uncertainty(
    scene: Scene, state: MotionState, cameras: Cameras, options: MotionParams, noise: Noise
) -> Uncertainty:
    """The posterior of a result.

    Args:
        state: every video's motion in its own camera's axes (batch of M).
        cameras: of the result; options: as it was made with.
    """
    videos, options = len(scene.observations), noise.options(options)
    if videos == 1:
        (fit,) = own_fits(noise.scene(scene, 1), state, None, options, noise)
        own = own_posterior(fit)
        claim = joint_claim(scene.body, fit.state, own.given_shape, own.response)
        alone = claim.covariance(torch.linalg.inv(own.schur)).cpu().numpy()
        return Uncertainty([alone], state, own.normal, None)
    settled = settle_common(scene, state, cameras, options)
    common = common_posterior(noise.scene(scene, 1), settled, noise)
    fits = own_fits(noise.scene(scene, videos), state, settled, options, noise)

    def claimed(v: int) -> tuple[JointClaim, Tensor]:
        own = own_posterior(fits[v])
        carried = common.seen_by(v)[nearest_reference(scene.timeline.to_reference[v], len(common))]
        frames = own.given_shape + own.gain @ carried @ own.gain.mT
        return joint_claim(scene.body, fits[v].state, frames, own.response), own.schur

    claims, schurs = zip(*at_once(claimed, range(videos)), strict=True)
    shape = torch.linalg.inv(torch.stack(schurs).sum(0))
    joints = [claim.covariance(shape).cpu().numpy() for claim in claims]
    return Uncertainty(joints, settled.motion, common.normal, common)


def nearest_reference(to_reference: Array, frames: int) -> NDArray[np.int64]:
    """(T,) nearest of ``frames`` reference frames; a frame without one takes its neighbours'."""
    known = np.isfinite(to_reference)
    if not known.any():
        return np.zeros(len(to_reference), dtype=np.int64)
    own = np.arange(len(to_reference))
    at = np.interp(own, own[known], to_reference[known]).round().astype(np.int64)
    return np.clip(at, 0, frames - 1)
