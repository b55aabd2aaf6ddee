"""Views and unknowns of a batch of hands over time, and the terms of their objective.

A hand's wrist turns against the forearm, which the body's fit gives for every view; so one hand
that is common to several videos has one set of rotations, and every view its own forearm, place of
the wrist and camera.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from imocap_core.hands.hand_skeleton import ANGLE_NAMES, POINTS, HandSkeleton, hand_points
from imocap_core.motion.multiview.timeline import (
    Timeline,
    sample,
    sample_keypoints,
    sample_rotations,
)
from imocap_core.motion.normal import NormalEquations
from imocap_core.robust import cauchy, geman_mcclure
from imocap_core.rotations import exp, log, mean, right_jacobian


@dataclass(frozen=True, kw_only=True)
class HandWeights:
    """The spreads and limits of every fit of hands; `coupling_rad`, `acceleration_rad_s2` and
    `pose_prior` were chosen on *taichi* of another seed.

    Standard deviations: noise_share of a keypoint, as a share of the hand's length; wrist_rad,
    offset_m of a wrist's rotation and position about the body's, which says little about a
    forearm's twist; acceleration_rad_s2, offset_acceleration_m_s2; size_spread of the logarithm of
    the hands' size, relative to the body's shape.
    robust_scale_sigma: of the Geman-McClure loss of keypoint distances, in standard deviations.
    min_confidence of a keypoint that is used; a hand with fewer than min_points is unseen.
    pose_prior: weight of squared finger angles, relative to the spread of everyday poses.
    limit_rad: angle beyond a finger joint's range that costs 1; coupling_rad: difference from the
    hand common to all videos that does, which beyond agreement_rad stops following it.
    stride_s: between the frames in which all rotations of the wrist are tried as a start.
    """

    noise_share: float = 0.04
    robust_scale_sigma: float = 4.0
    min_confidence: float = 0.1
    min_points: int = 6
    wrist_rad: float = 0.8
    offset_m: float = 0.04
    pose_prior: float = 0.5
    limit_rad: float = 0.05
    coupling_rad: float = 0.3
    agreement_rad: float = 0.5
    acceleration_rad_s2: float = 20.0
    offset_acceleration_m_s2: float = 4.0
    size_spread: float = 0.15
    stride_s: float = 0.2
    max_steps: int = 15


@dataclass(frozen=True)
class HandViews:
    """B hands of T frames in V views each (batch first in every tensor).

    Attributes:
        bones: (B, 5, 4, 3), axes: (B, 5, 3, 3, 21): the skeleton of each hand.
        R_forearm: (B, T, V, 3, 3) camera from forearm; wrist_m: (B, T, V, 3) in camera axes;
            K: (B, V, 3, 3).
        xy_px: (B, T, V, 21, 2); weight: (B, T, V, 21) 1/px^2, 0 for a missing one.
        R_body: (B, T, 3, 3) forearm from hand as the body's fit has it.
        valid: (B, T) bool, False pads.
    """

    bones: Float[Tensor, "B 5 4 3"]
    axes: Float[Tensor, "B 5 3 3 21"]
    R_forearm: Float[Tensor, "B T V 3 3"]
    wrist_m: Float[Tensor, "B T V 3"]
    K: Float[Tensor, "B V 3 3"]
    xy_px: Float[Tensor, "B T V 21 2"]
    weight: Float[Tensor, "B T V 21"]
    R_body: Float[Tensor, "B T 3 3"]
    valid: Bool[Tensor, "B T"]

    def frames(self, index: Int[Tensor, " N"]) -> HandViews:
        """Some frames of the batch."""
        per_frame = ("R_forearm", "wrist_m", "xy_px", "weight", "R_body", "valid")
        return replace(self, **{name: getattr(self, name)[:, index] for name in per_frame})

    def single_frames(self, copies: int) -> HandViews:
        """Every frame as a motion of its own, `copies` times: batch B T copies of one frame."""
        batch, frames = self.valid.shape
        parts = {}
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name in ("bones", "axes", "K"):
                value = value[:, None].expand(batch, frames, *value.shape[1:])
            value = value.flatten(0, 1)[:, None].expand(-1, copies, *value.shape[2:])
            value = value.flatten(0, 1)
            parts[field.name] = value if field.name in ("bones", "axes", "K") else value[:, None]
        return HandViews(**parts)


@dataclass(frozen=True)
class HandState:
    """The unknowns.

    Attributes:
        R_wrist: (B, T, 3, 3) forearm from hand; angles: (B, T, 21) radians.
        offset_m: (B, T, V, 3) of the wrist from the body's, camera axes.
        size: factor of the bones, one for all.
    """

    R_wrist: Float[Tensor, "B T 3 3"]
    angles: Float[Tensor, "B T 21"]
    offset_m: Float[Tensor, "B T V 3"]
    size: float = 1.0

    def retract(self, step: Float[Tensor, "B T n"]) -> HandState:
        """The state after increments, n = 24 + 3 V of a frame."""
        return replace(
            self,
            R_wrist=self.R_wrist @ exp(step[..., :3]),
            angles=self.angles + step[..., 3:24],
            offset_m=self.offset_m + step[..., 24:].reshape(self.offset_m.shape),
        )

    def where(self, chosen: Bool[Tensor, " B"], other: HandState) -> HandState:
        """This state in the chosen hands of the batch, the other state elsewhere."""

        def pick(a: Tensor, b: Tensor) -> Tensor:
            return torch.where(chosen.reshape(-1, *[1] * (a.ndim - 1)), a, b)

        return replace(
            self,
            R_wrist=pick(self.R_wrist, other.R_wrist),
            angles=pick(self.angles, other.angles),
            offset_m=pick(self.offset_m, other.offset_m),
        )


@dataclass(frozen=True)
class CommonHand:
    """The hand motion common to all videos.

    Attributes:
        R_wrist: (B, T, 3, 3) forearm from hand; angles: (B, T, 21) radians.
        trust: (B, T) in [0, 1] of each frame's correspondence.
    """

    R_wrist: Float[Tensor, "B T 3 3"]
    angles: Float[Tensor, "B T 21"]
    trust: Float[Tensor, "B T"]


FLOOR_PX = 0.5  # least standard deviation of a keypoint


@dataclass(frozen=True)
class ArmsAndHands:
    """One video's arms and hand keypoints; left, right first.

    Attributes:
        R_forearm: (2, T, 3, 3) camera from forearm; wrist_m: (2, T, 3) camera axes.
        R_body: (2, T, 3, 3) forearm from hand, as the body's fit has it.
        K: (3, 3) intrinsics; fps: frames a second.
        xy_px: (2, T, 21, 2); weight: (2, T, 21) 1/px^2, 0 for missing points and hands.
    """

    R_forearm: Float[Tensor, "2 T 3 3"]
    wrist_m: Float[Tensor, "2 T 3"]
    R_body: Float[Tensor, "2 T 3 3"]
    K: Float[Tensor, "3 3"]
    fps: float
    xy_px: Float[np.ndarray, "2 T 21 2"]
    weight: Float[np.ndarray, "2 T 21"]

    @property
    def frames(self) -> int:
        """T."""
        return self.weight.shape[1]

    @property
    def visible(self) -> Bool[Tensor, "2 T"]:
        """Whether any keypoint of a hand is used."""
        return torch.as_tensor((self.weight > 0).any(-1), device=self.K.device)


def point_weights(
    xy_px: Float[np.ndarray, "*hands K 2"],
    confidence: Float[np.ndarray, "*hands K"],
    hand_px: Float[np.ndarray, "*hands"],
    weights: HandWeights,
) -> Float[np.ndarray, "*hands K"]:
    """Inverse variances of a hand's keypoints, 1/px^2; 0 for a missing one.

    Args:
        hand_px: length of each hand in the picture.

    Raises:
        ValueError: not 21 keypoints.
    """
    if confidence.shape[-1] != POINTS:
        raise ValueError(f"confidence: expected (..., {POINTS}), got {confidence.shape}")
    usable = np.isfinite(xy_px).all(-1) & (confidence >= max(weights.min_confidence, 1e-6))
    usable &= usable.sum(-1, keepdims=True) >= weights.min_points
    sigma = np.hypot(weights.noise_share * hand_px, FLOOR_PX)[..., None]
    return np.where(usable, np.nan_to_num(confidence) / sigma**2, 0.0)


def fps_of(videos: Sequence[ArmsAndHands]) -> Float[Tensor, " B"]:
    """Frame rate of every hand of `per_video_views`."""
    return videos[0].K.new_tensor([v.fps for v in videos for _ in range(2)])


def per_video_views(skeleton: HandSkeleton, videos: Sequence[ArmsAndHands]) -> HandViews:
    """Two hands a video, (2 M, T) padded by their last frame, each in its own video's view."""
    length = max(v.frames for v in videos)

    def padded(values: Tensor) -> Tensor:
        last = values[:, -1:].expand(-1, length - values.shape[1], *values.shape[2:])
        return torch.cat([values, last], dim=1)

    def batch(name: str) -> Tensor:
        return torch.cat([padded(torch.as_tensor(getattr(v, name)).to(v.K)) for v in videos])

    device = skeleton.bones.device
    lengths = torch.tensor([v.frames for v in videos for _ in range(2)], device=device)
    valid = torch.arange(length, device=device) < lengths[:, None]
    weight = torch.where(valid[..., None], batch("weight"), 0.0)
    return HandViews(
        bones=skeleton.bones.repeat(len(videos), 1, 1, 1),
        axes=skeleton.axes.repeat(len(videos), 1, 1, 1, 1),
        R_forearm=batch("R_forearm")[:, :, None],
        wrist_m=batch("wrist_m")[:, :, None],
        K=torch.stack([v.K for v in videos for _ in range(2)])[:, None],
        xy_px=batch("xy_px").nan_to_num()[:, :, None],
        weight=weight[:, :, None],
        R_body=batch("R_body"),
        valid=valid,
    )


def common_views(
    skeleton: HandSkeleton, videos: Sequence[ArmsAndHands], timeline: Timeline
) -> HandViews:
    """The hands common to all videos, (2, N) at the reference's frames, in every video's view."""
    per_side = [_common_side(side, videos, timeline) for side in range(2)]
    R_forearm, wrist, xy, weight, R_body = (
        torch.stack(part) for part in zip(*per_side, strict=True)
    )
    return HandViews(
        bones=skeleton.bones,
        axes=skeleton.axes,
        R_forearm=R_forearm,
        wrist_m=wrist,
        K=torch.stack([v.K for v in videos]).expand(2, -1, 3, 3),
        xy_px=xy,
        weight=weight,
        R_body=R_body,
        valid=torch.ones_like(weight[:, :, 0, 0], dtype=torch.bool),
    )


def _common_side(side: int, videos: Sequence[ArmsAndHands], timeline: Timeline) -> list[Tensor]:
    columns: list[list[Tensor]] = [[] for _ in range(5)]
    for v, video in enumerate(videos):
        frame = timeline.from_reference[v]
        xy, weight = sample_keypoints(video.xy_px[side], video.weight[side], frame)
        trusted = weight * timeline.confidence[v][:, None]
        row = (
            sample_rotations(video.R_forearm[side][:, None], frame)[:, 0],
            sample(video.wrist_m[side], frame),
            torch.as_tensor(xy).to(video.K),
            torch.as_tensor(trusted).to(video.K),
            sample_rotations(video.R_body[side][:, None], frame)[:, 0],
        )
        for column, value in zip(columns, row, strict=True):
            column.append(value)
    *parts, R_body = (torch.stack(column, dim=1) for column in columns)
    trust = torch.as_tensor(timeline.confidence.T).to(R_body) + 1e-6
    return [*parts, mean(R_body, trust, dim=1)]


def common_at(common: HandState, videos: Sequence[ArmsAndHands], timeline: Timeline) -> CommonHand:
    """The common hands (2, N) at the frames of every video, (2 M, T); trust 0 where unmatched.

    An unmatched frame takes its neighbours' place.
    """
    length = max(v.frames for v in videos)
    count = common.angles.shape[1]
    R, angles, trust = [], [], []
    for v, to_reference in enumerate(timeline.to_reference):
        matched = np.nonzero(np.isfinite(to_reference))[0]
        frames, position = np.arange(length), np.zeros(length)
        if len(matched):
            position = np.interp(frames, matched, to_reference[matched])
        inside = np.clip(position, 0, count - 1)
        confidence = np.interp(inside, np.arange(count), timeline.confidence[v])
        of_video = torch.as_tensor(confidence * np.isin(frames, matched)).to(common.angles)
        for side in range(2):
            R.append(sample_rotations(common.R_wrist[side][:, None], position)[:, 0])
            angles.append(sample(common.angles[side], position))
            trust.append(of_video)
    return CommonHand(torch.stack(R), torch.stack(angles), torch.stack(trust))


ROTATIONS = 24  # unknowns of a frame: 3 of the wrist, 21 angles; then 3 a view of its offset
NEAREST_M = 0.1  # least depth of a projected point
_END_SHARE, _END_SPREAD_RAD = 0.65, 0.25  # the last joint of a finger follows the one before
_GROUPS = [[0, 1, 2], *([3 + 4 * f + k for k in range(4)] for f in range(4)), [*range(19, 24)]]

Equations = NormalEquations | None


def _project_hands(
    views: HandViews, state: HandState
) -> tuple[Float[Tensor, "B T V 21 2"], Float[Tensor, "B T V 21 2 28"]]:
    """Pixels of the hands and their derivatives: by the rotations (24), the offset of the same view
    (3), and the logarithm of the size (1)."""
    bones, axes = views.bones[:, None] * state.size, views.axes[:, None]
    xyz, d_wrist, d_angles = hand_points(bones, axes, state.R_wrist, state.angles)
    R = views.R_forearm[..., None, :, :]  # (B, T, V, 1, 3, 3)
    place = (views.wrist_m + state.offset_m)[..., None, :]
    in_camera = (R @ xyz[:, :, None, :, :, None])[..., 0] + place
    h = (views.K[:, None, :, None] @ in_camera[..., None])[..., 0]
    depth = h[..., 2:].clamp_min(NEAREST_M)
    pixels = h[..., :2] / depth
    K = views.K[:, None, :, None]
    by_place = (K[..., :2, :] - pixels[..., None] * K[..., 2:, :]) / depth[..., None]
    turned = by_place @ R
    by_turns = turned @ torch.cat([d_wrist, d_angles], dim=-1)[:, :, None]
    by_size = turned @ xyz[:, :, None, :, :, None]
    return pixels, torch.cat([by_turns, by_place, by_size], dim=-1)


def image_cost(
    views: HandViews, state: HandState, weights: HandWeights, normal: Equations = None
) -> Float[Tensor, " B"]:
    """Robust distance of the projected hands to the detected keypoints."""
    pixels, jacobian = _project_hands(views, state)
    miss = torch.where(views.weight[..., None] > 0, pixels - views.xy_px, 0.0)
    squared = views.weight * (miss**2).sum(-1)
    cost, share = geman_mcclure(squared, weights.robust_scale_sigma)
    if normal is not None:
        w = (views.weight * share)[..., None].expand_as(miss)
        rows, rest, w = (x.flatten(3, 4) for x in (jacobian, miss, w))  # (B, T, V, 42, ...)
        lever = rows * w[..., None]
        square = lever.transpose(-1, -2) @ rows
        slope = (lever * rest[..., None]).sum(-2)
        turn, offset, size = slice(0, ROTATIONS), slice(ROTATIONS, -1), slice(-1, None)
        normal.diagonal[..., turn, turn] += square[..., turn, turn].sum(2)
        normal.gradient[..., turn] += slope[..., turn].sum(2)
        normal.border[..., turn, :] += square[..., turn, size].sum(2)
        normal.corner += square[..., size, size].sum((1, 2))
        normal.corner_gradient += slope[..., size].sum((1, 2))
        for v in range(square.shape[2]):
            of_view = slice(ROTATIONS + 3 * v, ROTATIONS + 3 * v + 3)
            normal.diagonal[..., of_view, of_view] += square[:, :, v, offset, offset]
            normal.diagonal[..., turn, of_view] += square[:, :, v, turn, offset]
            normal.diagonal[..., of_view, turn] += square[:, :, v, offset, turn]
            normal.gradient[..., of_view] += slope[:, :, v, offset]
            normal.border[..., of_view, :] += square[:, :, v, offset, size]
    return cost.sum((1, 2, 3))


def prior_cost(
    views: HandViews,
    state: HandState,
    skeleton: HandSkeleton,
    weights: HandWeights,
    normal: Equations = None,
) -> Float[Tensor, " B"]:
    """Priors of poses, ranges of motion, and the wrist's rotation and offset from the body's."""
    vectors = log(views.R_body.transpose(-1, -2) @ state.R_wrist)
    wrist = vectors / weights.wrist_rad
    turn = torch.linalg.inv(right_jacobian(vectors)) / weights.wrist_rad
    offset = state.offset_m.flatten(2) / weights.offset_m
    pose = _pose_rows(skeleton.spread) * weights.pose_prior
    rest = state.angles @ pose.T
    over = torch.relu(state.angles - skeleton.upper) - torch.relu(skeleton.lower - state.angles)
    over = over / weights.limit_rad
    used = views.valid.to(state.angles)
    if normal is not None:
        u = used[..., None]
        normal.diagonal[..., :3, :3] += u[..., None] * (turn.transpose(-1, -2) @ turn)
        normal.gradient[..., :3] += u * (turn.transpose(-1, -2) @ wrist[..., None])[..., 0]
        hit = (over != 0).to(u) / weights.limit_rad
        normal.diagonal[..., 3:24, 3:24] += u[..., None] * (
            pose.T @ pose + torch.diag_embed(hit**2)
        )
        normal.gradient[..., 3:24] += u * (rest @ pose + hit * over)
        torch.diagonal(normal.diagonal, dim1=-2, dim2=-1)[..., 24:] += u / weights.offset_m**2
        normal.gradient[..., 24:] += u * offset / weights.offset_m
    total = sum((x**2).sum(-1) for x in (wrist, offset, rest, over))
    return (used * total).sum(1)


def _pose_rows(spread: Tensor) -> Tensor:
    """(25, 21): each angle by its spread, and the end joints against those before them."""
    rows = [*torch.diag(1 / spread)]
    for f in range(4):
        row = torch.zeros_like(spread)
        bend2, bend3 = (ANGLE_NAMES.index(n) for n in ANGLE_NAMES[4 * f + 2 : 4 * f + 4])
        row[bend3], row[bend2] = 1 / _END_SPREAD_RAD, -_END_SHARE / _END_SPREAD_RAD
        rows.append(row)
    return torch.stack(rows)


def smooth_cost(
    views: HandViews,
    state: HandState,
    weights: HandWeights,
    fps: Float[Tensor, " B"],
    normal: Equations = None,
) -> Float[Tensor, " B"]:
    """Accelerations of wrist, fingers and offset."""
    if state.angles.shape[1] < 3:
        return state.angles.new_zeros(len(state.angles))
    turn = log(state.R_wrist[:, :-1].transpose(-1, -2) @ state.R_wrist[:, 1:])
    steps = torch.cat([turn, state.angles.diff(dim=1), state.offset_m.flatten(2).diff(dim=1)], -1)
    scale = torch.full_like(steps[0, 0], 1 / weights.acceleration_rad_s2)
    scale[ROTATIONS:] = 1 / weights.offset_acceleration_m_s2
    w = (fps[:, None, None] ** 2 * scale) ** 2 * views.valid[:, 2:, None]
    change = steps.diff(dim=1)
    if normal is not None:  # rows 1, -2, 1 over three frames: small turns add up
        frames, pull = change.shape[1], w * change
        for lag, share in enumerate((1.0, -2.0, 1.0)):
            span = slice(lag, lag + frames)
            torch.diagonal(normal.diagonal, dim1=-2, dim2=-1)[:, span] += share**2 * w
            normal.gradient[:, span] += share * pull
        torch.diagonal(normal.next1, dim1=-2, dim2=-1)[:, :frames] += -2 * w
        torch.diagonal(normal.next1, dim1=-2, dim2=-1)[:, 1 : frames + 1] += -2 * w
        torch.diagonal(normal.next2, dim1=-2, dim2=-1)[:, :frames] += w
    return (w * change**2).sum((1, 2))


def coupling_cost(
    views: HandViews,
    state: HandState,
    common: CommonHand,
    weights: HandWeights,
    normal: Equations = None,
) -> Float[Tensor, " B"]:
    """Differences from the common motion, robustly for the wrist and for each finger."""
    vectors = log(common.R_wrist.transpose(-1, -2) @ state.R_wrist)
    away = torch.cat([vectors, state.angles - common.angles], -1) / weights.coupling_rad
    trust = common.trust * views.valid
    scale = weights.agreement_rad / weights.coupling_rad
    total = torch.zeros_like(trust)
    inverse = torch.linalg.inv(right_jacobian(vectors))
    for group in _GROUPS:
        part = away[..., group]
        cost, share = cauchy((part**2).sum(-1), scale)
        total = total + trust * cost
        if normal is None:
            continue
        w = (trust * share)[..., None]
        if group[0] == 0:
            rows = inverse / weights.coupling_rad
            normal.diagonal[..., :3, :3] += w[..., None] * (rows.transpose(-1, -2) @ rows)
            normal.gradient[..., :3] += w * (rows.transpose(-1, -2) @ part[..., None])[..., 0]
        else:
            span = slice(group[0], group[-1] + 1)
            diagonal = torch.diagonal(normal.diagonal, dim1=-2, dim2=-1)
            diagonal[..., span] += w / weights.coupling_rad**2
            normal.gradient[..., span] += w * part / weights.coupling_rad
    return total.sum(1)
