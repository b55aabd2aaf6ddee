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

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from imocap_core.motion.monocular.fit import Progress
from imocap_core.motion.multiview.scene import JointMotion, Scene
from imocap_core.motion.posterior.common_posterior import (
    CommonPosterior,
    common_evidence,
    common_posterior,
    with_common_motion,
)
from imocap_core.motion.posterior.joint_covariance import (
    VectorCovariance,
    joined,
    joint_jacobian,
    of_whole_frame,
    vector_covariance,
)
from imocap_core.motion.posterior.noise import Noise
from imocap_core.motion.posterior.per_video_posterior import (
    PerVideoFit,
    PosteriorPiece,
    per_video_fits,
    per_video_posterior,
)
from imocap_core.motion.solver.gauss_newton import motions_at_once
from imocap_core.motion.state import POSE, MotionState
from imocap_core.motion.terms import Term
from imocap_core.params import MotionParams
from imocap_core.workers import at_once

POSTERIOR_MEMORY = 2  # of a motion, in memory of its normal equations: their factors, too


@dataclass(frozen=True)
class MotionPosterior:
    """The posterior of a result.

    Attributes:
        covariances_m2: per video (T_v, 24, 3, 3), the video's camera axes, joints about the middle
            of the hips; NaN where the normal matrix was not positive definite.
        rotations_rad2: per video (T_v, K, 3, 3) of the rotations that `motion_posterior` was asked
            for; NaN likewise.
        camera_rotation_rad: per video the standard deviation of its camera's rotation.
        motion: the motion seen by all videos (batch of 1, world axes; a single video's own).
        terms: whose normal matrix at the motion was inverted; common: None for one video.
    """

    covariances_m2: list[Float[np.ndarray, "_ 24 3 3"]]
    rotations_rad2: list[Float[np.ndarray, "_ K 3 3"]]
    camera_rotation_rad: list[float]
    motion: MotionState
    terms: list[Term]
    common: CommonPosterior | None


@dataclass(frozen=True)
class _VideoCovariance:
    """Covariances of a video's joints and rotations, of its body's shape as yet unknown, and its
    information about the shape (10, 10)."""

    joints: VectorCovariance
    rotations: VectorCovariance
    schur: Tensor


def no_rotations(motion: MotionState) -> Float[Tensor, "T 0 3 72"]:
    """Derivatives of no rotation at all."""
    return motion.trans.new_zeros(motion.trans.shape[1], 0, 3, POSE)


def motion_posterior(
    scene: Scene,
    result: JointMotion,
    options: MotionParams,
    noise: Noise,
    rotation_rows: Callable[[MotionState], Float[Tensor, "T K 3 72"]] = no_rotations,
    progress: Progress = lambda _: None,
) -> MotionPosterior:
    """The posterior of a result of SMPL-BA.

    Args:
        options: as it was made with.
        rotation_rows: derivatives of K rotations, as vectors, by the increments of a motion (a
            batch of 1).
    """
    videos, options = len(scene.observations), noise.options(options)
    if videos == 1:
        return _of_single_video(scene, result.state, options, noise, rotation_rows)
    progress("the motion of all videos")
    evidence = common_evidence(scene, with_common_motion(scene, result, options), options)
    common = common_posterior(noise.scene(scene, 1), evidence, noise)
    progress("each video's own motion")
    fits = per_video_fits(noise.scene(scene, videos), result.state, evidence, options, noise)

    def of_video(v: int) -> _VideoCovariance:
        at_reference = nearest_reference(scene.timeline.to_reference[v], len(common))

        def given_shape(piece: PosteriorPiece) -> Tensor:
            carried = common.in_camera_axes(v, at_reference[piece.frames])
            return piece.given_shape + piece.gain @ carried @ piece.gain.mT

        return _video_covariance(scene, fits[v], given_shape, rotation_rows)

    frames = result.state.valid.shape[1]
    performers, most = scene.performers, motions_at_once(POSTERIOR_MEMORY * frames)
    by_video: list[_VideoCovariance] = at_once(of_video, range(videos), most)
    shapes = [
        torch.linalg.inv(
            torch.stack([v.schur for v, q in zip(by_video, performers, strict=True) if q == p]).sum(
                0
            )
        )
        for p in range(max(performers) + 1)
    ]
    return MotionPosterior(
        [_in_numpy(v.joints, shapes[p]) for v, p in zip(by_video, performers, strict=True)],
        [_in_numpy(v.rotations, shapes[p]) for v, p in zip(by_video, performers, strict=True)],
        [common.camera_rotation_sd_rad(v) for v in range(videos)],
        common.evidence.motion,
        common.terms,
        common,
    )


def _of_single_video(
    scene: Scene,
    state: MotionState,
    options: MotionParams,
    noise: Noise,
    rotation_rows: Callable[[MotionState], Tensor],
) -> MotionPosterior:
    (fit,) = per_video_fits(noise.scene(scene, 1), state, None, options, noise)
    video = _video_covariance(scene, fit, lambda piece: piece.given_shape, rotation_rows)
    shape = torch.linalg.inv(video.schur)
    joints, rotations = _in_numpy(video.joints, shape), _in_numpy(video.rotations, shape)
    return MotionPosterior([joints], [rotations], [0.0], state, fit.terms, None)


def _video_covariance(
    scene: Scene,
    fit: PerVideoFit,
    given_shape: Callable[[PosteriorPiece], Float[Tensor, "P 75 75"]],
    rotation_rows: Callable[[MotionState], Tensor],
) -> _VideoCovariance:
    """given_shape: covariance of the video's increments in some frames, the shape known."""

    def of_piece(piece: PosteriorPiece) -> tuple[VectorCovariance, VectorCovariance]:
        given = given_shape(piece), piece.response
        joints = joint_jacobian(scene.body, fit.state, piece.frames)
        turned = of_whole_frame(rotation_rows(fit.state.of_frames(piece.frames)))
        return vector_covariance(*joints, *given), vector_covariance(turned, None, *given)

    parts, schur = per_video_posterior(fit, of_piece)
    of_joints, of_rotations = zip(*parts, strict=True)
    return _VideoCovariance(joined(of_joints), joined(of_rotations), schur)


def _in_numpy(vectors: VectorCovariance, shape: Tensor) -> Float[np.ndarray, "T K 3 3"]:
    return np.asarray(vectors.covariance(shape).cpu().numpy())


def nearest_reference(to_reference: Float[np.ndarray, " T"], frames: int) -> Int[np.ndarray, " T"]:
    """Nearest of ``frames`` reference frames; an unmatched frame takes its neighbours'."""
    matched = np.isfinite(to_reference)
    if not matched.any():
        return np.zeros(len(to_reference), dtype=np.int64)
    index = np.arange(len(to_reference))
    position = np.interp(index, index[matched], to_reference[matched])
    return np.clip(position.round().astype(np.int64), 0, frames - 1)
