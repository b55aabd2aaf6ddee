"""What the videos leave open, and which further viewpoint would help most.

Ill-determined joints and phases, near-identical viewpoints, and the viewpoint that would help most.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.gauss_newton import linearise, motions_at_once
from imocap_core.motion.motion_posterior import CommonPosterior, MotionPosterior
from imocap_core.motion.multiview.scene import JointMotion, Scene
from imocap_core.motion.normal import NormalEquations
from imocap_core.motion.observations import per_video_view
from imocap_core.motion.posterior_noise import HIPS, joint_jacobian
from imocap_core.motion.selected_inversion import selected_inverse
from imocap_core.motion.state import FRAME_UNKNOWNS, Body, MotionState
from imocap_core.motion.terms import Reprojection, View
from imocap_core.motion.terms.base import pieces
from imocap_core.motion.terms.view import project
from imocap_core.sequences import runs
from imocap_core.sync.warp.template import OFFSET_START
from imocap_core.workers import thread_map

LEAST_FACING = 0.5  # length of the mean facing below which the performer turns round


@dataclass(frozen=True)
class PerformerAxes:
    """The performer's place and axes in the world: unit vectors and metres.

    Azimuth 0 is in front of the performer (of the first camera where the performer turns round),
    90 on the performer's left.
    """

    middle: Float[np.ndarray, "3"]
    front: Float[np.ndarray, "3"]
    left: Float[np.ndarray, "3"]
    up: Float[np.ndarray, "3"]
    by_performer: bool

    def outward(self, azimuth_deg: float) -> Float[np.ndarray, "3"]:
        """Unit vector from the performer to a camera at this azimuth."""
        a = np.radians(azimuth_deg)
        return np.cos(a) * self.front + np.sin(a) * self.left

    def azimuth_deg(self, towards_performer: Float[np.ndarray, "3"]) -> float:
        """Azimuth, 0 to 360, of a camera that looks along ``towards_performer``."""
        back = -towards_performer
        return float(np.degrees(np.arctan2(back @ self.left, back @ self.front)) % 360)


def performer_axes(
    body: Body,
    motion: MotionState,
    R_cam_from_world: Float[np.ndarray, "M 3 3"],
    ahead: Float[np.ndarray, "3"],
) -> PerformerAxes:
    """The performer's axes from a motion (batch of 1, world axes).

    Args:
        R_cam_from_world: their mean upright is the world's (cameras are held upright).
        ahead: unit vector in which the first camera looks.
    """
    joints = body.positions(body.joints, motion)[0].cpu().numpy()
    up = -R_cam_from_world[:, 1].mean(0)
    up /= np.linalg.norm(up)
    left = joints[:, HIPS[0]] - joints[:, HIPS[1]]
    facing = np.cross(left, up)
    facing /= np.linalg.norm(facing, axis=-1, keepdims=True) + 1e-9
    front = facing.mean(0)
    by_performer = bool(np.linalg.norm(front) > LEAST_FACING)
    if not by_performer:
        front = -ahead
    front = front - (front @ up) * up
    front /= np.linalg.norm(front)
    return PerformerAxes(joints[:, 0].mean(0), front, np.cross(up, front), up, by_performer)


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
    after = np.array(thread_map(with_camera, AZIMUTHS_DEG, most))
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
    xyz = body.positions(body.keypoints, motion)
    weight = torch.full(xyz.shape[:3], camera.weight).to(motion.trans)
    precision = torch.as_tensor(camera.offset_sd**-2.0).to(motion.trans)
    precision = precision.expand(1, xyz.shape[1], -1)
    view = View(xyz[..., :2], weight, K_, R_, t_, offset_precision=precision)
    return replace(view, xy_px=project(view, xyz)[0])


def camera_like(posterior: CommonPosterior) -> ExtraCamera:
    """A camera of the given ones' median distance, focal length and noise."""
    keypoints, motion = posterior.evidence.views.keypoints, posterior.evidence.motion
    cameras = posterior.evidence.views.cameras
    depth = motion.trans[0].mean(0) @ cameras.R.mT + cameras.t
    return ExtraCamera(
        float(depth[:, 2].median()),
        float(cameras.K[:, 0, 0].median()),
        float(np.median(keypoints.weight[keypoints.weight > 0])),
        np.sqrt(np.square(posterior.evidence.spread.offset_sd).mean(0)),
    )


def camera_for_single(motion: MotionState, view: View) -> ExtraCamera:
    """A second camera for a video by itself, its rigid offset as large as any start."""
    weight = view.weight[view.weight > 0]
    return ExtraCamera(
        float(motion.trans[0, :, 2].median()),
        float(view.K[0, 0, 0]),
        float(weight.median()) if len(weight) else 0.0,
        np.array(OFFSET_START),
    )


_NEAR_DEG = 20.0  # videos whose lines of sight differ by less are near-identical views
ACROSS_DEG = 30.0  # a video this far off a line of sight determines depth along it
LEAST_SPAN_S = 0.2  # shorter ones are not reported
GAP_S = 0.2  # spans of one joint closer than this are one


@dataclass(frozen=True)
class WeakInterval:
    """Frames ``first`` to ``last`` (both within) in which a joint is ill-determined."""

    joint: int
    first: int
    last: int
    sigma: float  # root mean square over the span


@dataclass(frozen=True)
class NearViews:
    """Two videos and the angle between their directions to the performer."""

    a: int
    b: int
    angle_deg: float


@dataclass(frozen=True)
class ViewpointReport:
    """The viewpoints of a result.

    Attributes:
        azimuths_deg: (M,) mean azimuth of each camera about the performer.
        pairs: near-identical views; across: whether another video looks across theirs.
        reductions: (8,) share of the common motion's summed joint variance that one more camera
            at each of `viewpoints.AZIMUTHS_DEG` would take away.
        by_performer: False when azimuths count from the first camera (`azimuth.PerformerAxes`).
    """

    azimuths_deg: Float[np.ndarray, " M"]
    pairs: list[NearViews]
    across: list[bool]
    reductions: Float[np.ndarray, "8"]
    by_performer: bool


def viewpoint_report(
    scene: Scene, result: JointMotion, posterior: MotionPosterior, *, evidence_share: float
) -> ViewpointReport:
    """The viewpoints of a result and its posterior; evidence_share: see `Noise`."""
    cameras = result.cameras
    directions = view_directions(scene, result)
    mean = _mean(directions)
    ground = performer_axes(
        scene.body, posterior.motion, cameras.R.cpu().numpy(), mean[scene.reference]
    )
    angles = angles_deg(directions)
    pairs = near_pairs(angles, _NEAR_DEG)
    if posterior.common is None:
        view = per_video_view(scene.observations, result.state.trans)
        camera = camera_for_single(result.state, view)
    else:
        camera = camera_like(posterior.common)
    gain = reductions(
        scene.body, posterior.motion, linearise(posterior.terms, posterior.motion), ground, camera,
        scale=scene.fit.robust_scale_sigma, share=evidence_share,
    )  # fmt: skip
    return ViewpointReport(
        np.array([ground.azimuth_deg(direction) for direction in mean]),
        pairs,
        [seen_across(angles, pair.a, pair.b, ACROSS_DEG) for pair in pairs],
        gain,
        ground.by_performer,
    )


def weak_spans(sigma: Float[np.ndarray, "T J"], limit: float, fps: float) -> list[WeakInterval]:
    """Where standard deviations exceed ``limit``, worst first; NaN counts as 0."""
    spans = []
    for joint, column in enumerate(sigma.T):
        weak = np.nan_to_num(column) > limit
        gap = max(1, round(GAP_S * fps)) - 1
        for first, last in runs(weak, math.ceil(LEAST_SPAN_S * fps), gap):
            inside = column[first : last + 1]
            spans.append(WeakInterval(joint, first, last, float(np.sqrt(np.nanmean(inside**2)))))
    return sorted(spans, key=lambda s: -s.sigma)


def view_directions(scene: Scene, result: JointMotion) -> Float[np.ndarray, "M N 3"]:
    """Unit vectors from each camera to its performer, world axes; NaN where unmatched."""
    aligned = scene.aligned(result.state)
    ray = torch.nn.functional.normalize(aligned.root, dim=-1)
    world = torch.einsum("mji,mnj->mni", result.cameras.R, ray)
    unmatched = (aligned.weight <= 0)[..., None]
    return torch.where(unmatched, torch.nan, world).cpu().numpy()


def _mean(directions: np.ndarray) -> np.ndarray:
    """(M, 3) over the frames that are matched; NaN for a video without any."""
    matched = np.isfinite(directions).all(-1, keepdims=True)
    count = matched.sum(1)
    total = np.where(matched, directions, 0.0).sum(1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def angles_deg(directions: Float[np.ndarray, "M N 3"]) -> Float[np.ndarray, "M M"]:
    """Median angle between two videos' directions over the frames that both have; NaN if none."""
    cosine = np.einsum("anx,bnx->abn", directions, directions).clip(-1, 1)
    angles = np.full(cosine.shape[:2], np.nan)
    for a, b in np.ndindex(*angles.shape):
        both = np.isfinite(cosine[a, b])
        if both.any():
            angles[a, b] = np.degrees(np.median(np.arccos(cosine[a, b, both])))
    return angles


def near_pairs(angles: Float[np.ndarray, "M M"], limit_deg: float) -> list[NearViews]:
    """Videos that see the performer from nearly the same side, nearest first."""
    pairs = [
        NearViews(a, b, float(angles[a, b]))
        for a in range(len(angles))
        for b in range(a + 1, len(angles))
        if angles[a, b] < limit_deg
    ]
    return sorted(pairs, key=lambda pair: pair.angle_deg)


def seen_across(angles: Float[np.ndarray, "M M"], a: int, b: int, limit_deg: float) -> bool:
    """Whether some video looks across the line of sight that ``a`` and ``b`` share."""
    off_axis = np.minimum(angles[a], 180 - angles[a])
    off_axis[[a, b]] = 0.0
    return bool(np.nanmax(off_axis) > limit_deg)
