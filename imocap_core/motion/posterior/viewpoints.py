"""Which further viewpoint would help most: the common motion's variance after one more camera."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.kinematics import Body
from imocap_core.motion.multiview.offset_spread import initial_offset_sd
from imocap_core.motion.posterior.azimuth import PerformerAxes
from imocap_core.motion.posterior.common_posterior import CommonPosterior
from imocap_core.motion.posterior.joint_covariance import joint_jacobian
from imocap_core.motion.solver.gauss_newton import motions_at_once
from imocap_core.motion.solver.normal import NormalEquations
from imocap_core.motion.solver.selected import selected_inverse
from imocap_core.motion.state import FRAME_UNKNOWNS, MotionState
from imocap_core.motion.terms import Reprojection, View
from imocap_core.motion.terms.in_time import pieces
from imocap_core.motion.terms.view import project
from imocap_core.params import MotionParams
from imocap_core.workers import at_once

AZIMUTHS_DEG = tuple(range(0, 360, 45))


@dataclass(frozen=True)
class ExtraCamera:
    """A camera like the given ones: metres, pixels, 1/px^2, and standard deviations (6,) of its
    performance's per-frame rigid offset (rad, m)."""

    distance_m: float
    focal_px: float
    weight: float
    offset_sd: Float[np.ndarray, "6"]


def reductions(
    body: Body,
    motion: MotionState,
    normal: NormalEquations,
    axes: PerformerAxes,
    camera: ExtraCamera,
    *,
    scale: float,
    share: float,
) -> Float[np.ndarray, "8"]:
    """Share by which the joints' summed variance falls with one more camera at each azimuth.

    The camera is level with the performer's middle and as far away, as sharp and with as much
    rigid offset as the given ones; its ``J^T W J`` is added and the inverse selected anew.
    Self-occlusion is not considered; cameras and shape are taken as known.

    Args:
        motion: batch of 1, N frames, world axes; normal: its normal matrix.
        scale: of the robust loss; share: weight of one frame's image evidence (`Noise`).
    """
    without = replace(motion, camera_R=motion.camera_R[:, :0], camera_t=motion.camera_t[:, :0])

    def variance(diagonal: Tensor) -> float:
        pieces = selected_inverse(diagonal, normal.next1[0], normal.next2[0])
        return sum(_summed(joint_jacobian(body, motion, p.frames)[0], p.diagonal) for p in pieces)

    def with_camera(azimuth_deg: float) -> float:
        view = _view(body, without, axes, camera, azimuth_deg)
        diagonal = normal.diagonal[0].clone()
        for frames in pieces(len(diagonal)):
            evidence = _evidence(body, without.of_frames(frames), view.of_frames(frames), scale)
            diagonal[frames].add_(evidence, alpha=share)
        return variance(diagonal)

    most = motions_at_once(motion.valid.shape[1])
    after = np.array(at_once(with_camera, AZIMUTHS_DEG, most))
    return 1 - after / variance(normal.diagonal[0])


def _evidence(
    body: Body, motion: MotionState, view: View, scale: float
) -> Float[Tensor, "T 75 75"]:
    """The view's information about each frame."""
    frames, shape = motion.valid.shape[1], motion.betas.shape[1]
    added = NormalEquations.zeros(1, frames, FRAME_UNKNOWNS, shape, motion.trans)
    Reprojection(body, (view,), scale).add_to(added, motion)
    return added.diagonal[0]


def _summed(rows: Tensor, covariance: Tensor) -> float:
    half = rows.flatten(1, 2) @ covariance
    return float((half * rows.flatten(1, 2)).sum())


def _view(
    body: Body, motion: MotionState, axes: PerformerAxes, camera: ExtraCamera, azimuth_deg: float
) -> View:
    """A view whose keypoints are the motion's projections."""
    outward = axes.outward(azimuth_deg)
    R = np.stack([np.cross(axes.up, outward), -axes.up, -outward])
    t = -R @ (axes.middle + camera.distance_m * outward)
    K = np.diag([camera.focal_px, camera.focal_px, 1.0])
    K_, R_, t_ = (torch.as_tensor(x).to(motion.trans)[None] for x in (K, R, t))
    xyz = body.positions(body.keypoints, motion).xyz
    weight = torch.full(xyz.shape[:3], camera.weight).to(motion.trans)
    precision = torch.as_tensor(camera.offset_sd**-2.0).to(motion.trans)
    precision = precision.expand(1, xyz.shape[1], -1)
    view = View(xyz[..., :2], weight, K_, R_, t_, offset_precision=precision)
    return replace(view, xy_px=project(view, xyz)[0])


def camera_like(posterior: CommonPosterior) -> ExtraCamera:
    """A camera of the given ones' median distance, focal length and noise."""
    keypoints, motion = posterior.evidence.keypoints, posterior.evidence.motion
    cameras = posterior.evidence.cameras
    depth = motion.trans[0].mean(0) @ cameras.R.mT + cameras.t
    return ExtraCamera(
        float(depth[:, 2].median()),
        float(cameras.K[:, 0, 0].median()),
        float(np.median(keypoints.weight[keypoints.weight > 0])),
        np.sqrt(np.square(posterior.evidence.spread.offset_sd).mean(0)),
    )


def camera_for_single(motion: MotionState, view: View, options: MotionParams) -> ExtraCamera:
    """A second camera for a video by itself, its rigid offset as large as any start."""
    weight = view.weight[view.weight > 0]
    return ExtraCamera(
        float(motion.trans[0, :, 2].median()),
        float(view.K[0, 0, 0]),
        float(weight.median()) if len(weight) else 0.0,
        initial_offset_sd(1, options)[0],
    )
