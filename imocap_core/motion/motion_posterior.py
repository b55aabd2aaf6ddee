"""Posterior covariance of every joint in every frame of every video.

Covariance of the motion common to all videos, its cameras and shape unknown. The model behind the
result: a common motion z, and each performance ``x_v = z + d_v`` with a deviation of given spread.
By the law of total covariance, in the linear Gaussian case exactly,

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

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from imocap_core.motion.gauss_newton import linearise, motions_at_once, split_batch
from imocap_core.motion.monocular.fit import Progress
from imocap_core.motion.multiview.common_motion import (
    NO_UNKNOWNS,
    CommonViews,
    Unknowns,
    estimate_spread,
    estimate_terms,
    fit_common_motion,
    views_of,
    with_initial_offsets,
    with_keypoint_spread,
)
from imocap_core.motion.multiview.per_video import (
    deviation_terms,
    facing_agreement,
    foot_contact_term,
    per_video_terms,
    targets_of,
)
from imocap_core.motion.multiview.scene import DeviationSpread, JointMotion, Scene, consensus_motion
from imocap_core.motion.normal import NormalEquations
from imocap_core.motion.posterior_noise import (
    Noise,
    VectorCovariance,
    joined,
    joint_jacobian,
    of_whole_frame,
    vector_covariance,
)
from imocap_core.motion.selected_inversion import selected_inverse
from imocap_core.motion.state import FRAME_UNKNOWNS, POSE, MotionState
from imocap_core.motion.terms import Reprojection, Term
from imocap_core.params import MotionParams
from imocap_core.rotations import hat
from imocap_core.workers import thread_map

T = TypeVar("T")


@dataclass(frozen=True)
class PerVideoFit:
    """One video's own fit (batch of 1, no padding): its motion, all its terms, and those of them
    that couple it to the common motion."""

    state: MotionState
    terms: list[Term]
    couplings: list[Term]


@dataclass(frozen=True)
class PosteriorPiece:
    """Covariance of one video's local increments in P of its frames, the common motion given.

    Attributes:
        frames: which.
        given_shape: (P, 75, 75) covariance of each frame if the shape were known.
        response: (P, 75, 10) how the frames follow the shape.
        gain: (P, 75, 75) how far each frame follows a persistent displacement of the common motion.
    """

    frames: slice
    given_shape: Float[Tensor, "P 75 75"]
    response: Float[Tensor, "P 75 10"]
    gain: Float[Tensor, "P 75 75"]


def per_video_fits(
    scene: Scene,
    state: MotionState,
    common: CommonEvidence | None,
    options: MotionParams,
    noise: Noise,
) -> list[PerVideoFit]:
    """Every video's own fit, with the evidence's weights of a posterior.

    Args:
        scene: with the priors of a posterior (`Noise.scene`).
        state: every video's motion in its own camera's axes.
        common: None for videos that were fitted by themselves.
    """
    terms = [*per_video_terms(scene, state.trans), foot_contact_term(scene, state, state)]
    terms = noise.temper(terms, scene.fps)
    couplings: list[Term] = []
    if common is not None:
        targets = targets_of(scene, state, common.motion, common.views.cameras)
        faces = facing_agreement(scene, state, targets)
        couplings = deviation_terms(
            scene, state, common.motion, targets, common.spread, options, faces
        )
    return [
        PerVideoFit(motion.state, motion.terms, motion.terms[len(terms) :])
        for motion in split_batch(terms + couplings, state)
    ]


def per_video_posterior(
    fit: PerVideoFit, use: Callable[[PosteriorPiece], T]
) -> tuple[list[T], Float[Tensor, "10 10"]]:
    """The inverse of a per-video fit's normal matrix, without damping, piece by piece.

    Args:
        use: what is made of a piece, which is too large to be kept.

    Returns:
        What was made of the pieces, and the video's information about the shape (inverse
        covariance; videos of one body add up).
    """
    pull = linearise(fit.couplings, fit.state).diagonal[0]  # (T, 75, 75) of the common motion
    normal = linearise(fit.terms, fit.state)
    fit.state.forget()
    border = normal.border[0]
    globals_, schur, results = border.shape[-1], normal.corner[0].clone(), list[T]()

    def right(t: int) -> Tensor:
        return torch.cat([border[t], pull[t]], 1)

    for piece in selected_inverse(normal.diagonal[0], normal.next1[0], normal.next2[0], right):
        response, gain = piece.solution[..., :globals_], piece.solution[..., globals_:]
        schur -= torch.einsum("tni,tnj->ij", border[piece.frames], response)
        results.append(use(PosteriorPiece(piece.frames, piece.diagonal, response, gain)))
    return results[::-1], schur


FIT_STEPS = 2  # of a common motion at the cameras of a result


@dataclass(frozen=True)
class CommonEvidence:
    """A result's common motion and the evidence for it.

    Attributes:
        motion: batch of 1, world axes, at the reference's N frames.
        views: every video's keypoints there, performances' deviations in their weights.
        spread: of the deviations; estimates: monocular estimates as terms.
    """

    motion: MotionState
    views: CommonViews
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
        motion, cameras = self.evidence.motion, self.evidence.views.cameras
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
    start = consensus_motion(scene, result.state, result.cameras)
    keypoints = with_initial_offsets(scene)
    views = CommonViews(scene.body, keypoints, result.cameras, scene.fit.robust_scale_sigma)
    terms = [*scene.regularisers, *estimate_terms(scene, start.trans, options)]
    motion, cameras, _ = fit_common_motion(views, start, NO_UNKNOWNS, terms, FIT_STEPS)
    spread = estimate_spread(scene, motion, cameras)
    return replace(result, common=motion, spread=spread)


def common_evidence(scene: Scene, result: JointMotion, options: MotionParams) -> CommonEvidence:
    """The evidence for a result's common motion (`with_common_motion` estimates one)."""
    assert result.common is not None
    assert result.spread is not None
    keypoints = replace(scene.keypoints, offset_sd=result.spread.offset_sd)
    views = CommonViews(scene.body, keypoints, result.cameras, scene.fit.robust_scale_sigma)
    views = with_keypoint_spread(views, result.common, result.spread.keypoints_m)
    estimates = estimate_terms(scene, result.common.trans, options)
    return CommonEvidence(result.common, views, result.spread, estimates)


def common_posterior(scene: Scene, evidence: CommonEvidence, noise: Noise) -> CommonPosterior:
    """The inverse of the common motion's normal matrix, without damping.

    Args:
        scene: with the priors of a posterior (`Noise.scene`).
    """
    videos, cameras = range(len(scene.observations)), evidence.views.cameras
    keypoints = evidence.views.keypoints
    free = [v for v in videos if v != scene.reference and (keypoints.weight[v] > 0).any()]
    motion = evidence.motion
    index = torch.tensor(free, dtype=torch.long, device=motion.trans.device)
    state = replace(motion, camera_R=cameras.R[index][None], camera_t=cameras.t[index][None])
    views = views_of(keypoints, cameras, state.trans, Unknowns(free))
    image = Reprojection(scene.body, views, scene.fit.robust_scale_sigma)
    terms = [
        *noise.temper([image], scene.fps),
        *evidence.estimates,  # counted once per correlation time by their own weights
        *scene.regularisers,
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


POSTERIOR_MEMORY = 2  # of a motion, in memory of its normal equations: their factors, too


@dataclass(frozen=True)
class MotionPosterior:
    """The posterior of a result.

    Attributes:
        covariances_m2: per video (T_v, 24, 3, 3), the video's camera axes, joints about the middle
            of the hips; NaN where the normal matrix was not positive definite.
        rotations_rad2: per video (T_v, K, 3, 3) of the rotations that `motion_posterior` was asked
            for; deviations_rad2: the same with the motion common to all videos given. NaN likewise.
        camera_rotation_rad: per video the standard deviation of its camera's rotation.
        motion: the motion seen by all videos (batch of 1, world axes; a single video's own).
        terms: whose normal matrix at the motion was inverted; common: None for one video.
    """

    covariances_m2: list[Float[np.ndarray, "_ 24 3 3"]]
    rotations_rad2: list[Float[np.ndarray, "_ K 3 3"]]
    deviations_rad2: list[Float[np.ndarray, "_ K 3 3"]]
    camera_rotation_rad: list[float]
    motion: MotionState
    terms: list[Term]
    common: CommonPosterior | None


@dataclass(frozen=True)
class _VideoCovariance:
    """Covariances of a video's joints and rotations, and of these with the common motion given, of
    its body's shape as yet unknown, and its information about the shape (10, 10)."""

    joints: VectorCovariance
    rotations: VectorCovariance
    deviations: VectorCovariance
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
    by_video: list[_VideoCovariance] = thread_map(of_video, range(videos), most)
    shapes = [
        torch.linalg.inv(
            torch.stack([v.schur for v, q in zip(by_video, performers, strict=True) if q == p]).sum(
                0
            )
        )
        for p in range(max(performers) + 1)
    ]
    of_videos = [shapes[p] for p in performers]
    return MotionPosterior(
        _in_numpy([v.joints for v in by_video], of_videos),
        _in_numpy([v.rotations for v in by_video], of_videos),
        _in_numpy([v.deviations for v in by_video], of_videos),
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
    shape = [torch.linalg.inv(video.schur)]
    joints, rotations, deviations = (
        _in_numpy([of], shape) for of in (video.joints, video.rotations, video.deviations)
    )
    return MotionPosterior(joints, rotations, deviations, [0.0], state, fit.terms, None)


def _video_covariance(
    scene: Scene,
    fit: PerVideoFit,
    given_shape: Callable[[PosteriorPiece], Float[Tensor, "P 75 75"]],
    rotation_rows: Callable[[MotionState], Tensor],
) -> _VideoCovariance:
    """given_shape: covariance of the video's increments in some frames, the shape known."""

    def of_piece(piece: PosteriorPiece) -> list[VectorCovariance]:
        given = given_shape(piece), piece.response
        joints = joint_jacobian(scene.body, fit.state, piece.frames)
        turned = of_whole_frame(rotation_rows(fit.state.of_frames(piece.frames)))
        return [
            vector_covariance(*joints, *given),
            vector_covariance(turned, None, *given),
            vector_covariance(turned, None, piece.given_shape, piece.response),
        ]

    parts, schur = per_video_posterior(fit, of_piece)
    joints, rotations, deviations = map(joined, zip(*parts, strict=True))
    return _VideoCovariance(joints, rotations, deviations, schur)


def _in_numpy(
    videos: Sequence[VectorCovariance], shapes: Sequence[Tensor]
) -> list[Float[np.ndarray, "_T K 3 3"]]:
    """Of every video's vectors, given its shape's covariance."""
    pairs = zip(videos, shapes, strict=True)
    return [np.asarray(of.covariance(shape).cpu().numpy()) for of, shape in pairs]


def nearest_reference(to_reference: Float[np.ndarray, " T"], frames: int) -> Int[np.ndarray, " T"]:
    """Nearest of ``frames`` reference frames; an unmatched frame takes its neighbours'."""
    matched = np.isfinite(to_reference)
    if not matched.any():
        return np.zeros(len(to_reference), dtype=np.int64)
    index = np.arange(len(to_reference))
    position = np.interp(index, index[matched], to_reference[matched])
    return np.clip(position.round().astype(np.int64), 0, frames - 1)
