"""Videos' hands as one batch: padded side by side, or brought to the reference's frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from imocap_core.hands.skeleton import POINTS, HandSkeleton
from imocap_core.hands.state import CommonHand, HandState, HandViews
from imocap_core.motion.multiview.timeline import (
    Timeline,
    sample,
    sample_keypoints,
    sample_rotations,
)
from imocap_core.rotations import mean

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
    *,
    noise_share: float,
    min_confidence: float,
    min_points: int,
) -> Float[np.ndarray, "*hands K"]:
    """Inverse variances of a hand's keypoints, 1/px^2; 0 for a missing one.

    Args:
        hand_px: length of each hand in the picture.
        min_points: a hand with fewer keypoints counts as missing.

    Raises:
        ValueError: not 21 keypoints.
    """
    if confidence.shape[-1] != POINTS:
        raise ValueError(f"confidence: expected (..., {POINTS}), got {confidence.shape}")
    usable = np.isfinite(xy_px).all(-1) & (confidence >= max(min_confidence, 1e-6))
    usable &= usable.sum(-1, keepdims=True) >= min_points
    sigma = np.hypot(noise_share * hand_px, FLOOR_PX)[..., None]
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
