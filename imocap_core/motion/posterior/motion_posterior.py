"""Posterior covariance of every joint in every frame of every video.

The model behind the result: a common motion z, and each performance ``x_v = z + d_v`` with a
deviation of given spread. By the law of total covariance, in the linear Gaussian case exactly,

    Cov(x_v) = Cov(x_v | z) + G_v Cov(z) G_v^T,

the inverse of the per-video fit's normal matrix with the common motion given, plus the common
motion's covariance (every view's images, cameras and shape unknown, `common_posterior`) carried
through by the gain ``G_v``: how far the video's motion follows a persistent displacement of the
common one. Joints follow by the kinematic Jacobian, the body's shape included
(`per_video_posterior`).

Neglected: that an error of the common motion changes within the reach of G (which overstates what
is carried), wrong correspondences beyond the spread they leave in the images, focal lengths and
lens distortion, the body model's own misfit, and everything not Gaussian: a limb on the wrong side
of a depth flip, or taken for its twin, is not covered by any of these numbers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from imocap_core.motion.multiview.scene import JointMotion, Scene
from imocap_core.motion.posterior.common_posterior import (
    CommonPosterior,
    common_evidence,
    common_posterior,
    with_common_motion,
)
from imocap_core.motion.posterior.joint_covariance import JointCovariance, joint_covariance
from imocap_core.motion.posterior.noise import Noise
from imocap_core.motion.posterior.per_video_posterior import per_video_fits, per_video_posterior
from imocap_core.motion.solver.normal import NormalEquations
from imocap_core.motion.state import MotionState
from imocap_core.params import MotionParams
from imocap_core.workers import at_once


@dataclass(frozen=True)
class MotionPosterior:
    """The posterior of a result.

    Attributes:
        covariances_m2: per video (T_v, 24, 3, 3), the video's camera axes, joints about the middle
            of the hips; NaN where the normal matrix was not positive definite.
        camera_rotation_rad: per video the standard deviation of its camera's rotation.
        motion: the motion seen by all videos (batch of 1, world axes; a single video's own).
        normal: its normal matrix; common: None for one video.
    """

    covariances_m2: list[Float[np.ndarray, "_ 24 3 3"]]
    camera_rotation_rad: list[float]
    motion: MotionState
    normal: NormalEquations
    common: CommonPosterior | None


def motion_posterior(
    scene: Scene, result: JointMotion, options: MotionParams, noise: Noise
) -> MotionPosterior:
    """The posterior of a result of SMPL-BA; options: as it was made with."""
    videos, options = len(scene.observations), noise.options(options)
    if videos == 1:
        return _of_single_video(scene, result.state, options, noise)
    evidence = common_evidence(scene, with_common_motion(scene, result, options), options)
    common = common_posterior(noise.scene(scene, 1), evidence, noise)
    fits = per_video_fits(noise.scene(scene, videos), result.state, evidence, options, noise)

    def joints_given_shape(v: int) -> tuple[JointCovariance, Tensor]:
        posterior = per_video_posterior(fits[v])
        frames = nearest_reference(scene.timeline.to_reference[v], len(common))
        carried = common.in_camera_axes(v)[frames]
        covariance = posterior.given_shape + posterior.gain @ carried @ posterior.gain.mT
        joints = joint_covariance(scene.body, fits[v].state, covariance, posterior.response)
        return joints, posterior.schur

    performers = scene.performers
    joints, schurs = zip(*at_once(joints_given_shape, range(videos)), strict=True)
    shapes = [
        torch.linalg.inv(
            torch.stack([s for s, q in zip(schurs, performers, strict=True) if q == p]).sum(0)
        )
        for p in range(max(performers) + 1)
    ]
    covariances = [
        of_video.covariance(shapes[p]).cpu().numpy()
        for of_video, p in zip(joints, performers, strict=True)
    ]
    rotations = [common.camera_rotation_sd_rad(v) for v in range(videos)]
    return MotionPosterior(covariances, rotations, evidence.motion, common.normal, common)


def _of_single_video(
    scene: Scene, state: MotionState, options: MotionParams, noise: Noise
) -> MotionPosterior:
    (fit,) = per_video_fits(noise.scene(scene, 1), state, None, options, noise)
    posterior = per_video_posterior(fit)
    joints = joint_covariance(scene.body, fit.state, posterior.given_shape, posterior.response)
    covariance = joints.covariance(torch.linalg.inv(posterior.schur)).cpu().numpy()
    return MotionPosterior([covariance], [0.0], state, posterior.normal, None)


def nearest_reference(to_reference: Float[np.ndarray, " T"], frames: int) -> Int[np.ndarray, " T"]:
    """Nearest of ``frames`` reference frames; an unmatched frame takes its neighbours'."""
    matched = np.isfinite(to_reference)
    if not matched.any():
        return np.zeros(len(to_reference), dtype=np.int64)
    index = np.arange(len(to_reference))
    position = np.interp(index, index[matched], to_reference[matched])
    return np.clip(position.round().astype(np.int64), 0, frames - 1)
