"""Videos' hands as one batch: padded side by side, or brought to the reference's frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from imocap_core.hands.problem import CommonHand, HandState, HandViews
from imocap_core.hands.skeleton import POINTS, HandSkeleton
from imocap_core.motion.multiview.timeline import (
    Timeline,
    sample,
    sample_keypoints,
    sample_rotations,
)
from imocap_core.rotations import mean

FLOOR_PX = 0.5  # no keypoint is known better


@dataclass(frozen=True)
class VideoHands:
    """One video's arms and hand keypoints; left, right first.

    Attributes:
        R_forearm (2, T, 3, 3), wrist_m (2, T, 3): camera from forearm, place of the wrist.
        R_body (2, T, 3, 3): forearm from hand, as the body's fit has it. K (3, 3). fps.
        xy_px (2, T, 21, 2); weight (2, T, 21): 1 / variance, 0 for unseen points and hands.
    """

    R_forearm: Tensor
    wrist_m: Tensor
    R_body: Tensor
    K: Tensor
    fps: float
    xy_px: NDArray[np.float64]
    weight: NDArray[np.float64]

    @property
    def frames(self) -> int:
        """T."""
        return self.weight.shape[1]

    @property
    def seen(self) -> Tensor:
        """(2, T) whether any point of a hand is used."""
        return torch.as_tensor((self.weight > 0).any(-1))


def point_weights(
    xy_px: NDArray[np.float64],
    confidence: NDArray[np.float64],
    hand_px: NDArray[np.float64],
    *,
    noise_share: float,
    min_confidence: float,
    min_points: int,
) -> NDArray[np.float64]:
    """(..., 21) 1 / variance of points (..., 21, 2) of hands that are ``hand_px`` (...) long.

    Hands with fewer than ``min_points`` points count as unseen.
    """
    if confidence.shape[-1] != POINTS:
        raise ValueError(f"confidence: expected (..., {POINTS}), got {confidence.shape}")
    usable = np.isfinite(xy_px).all(-1) & (confidence >= max(min_confidence, 1e-6))
    usable &= usable.sum(-1, keepdims=True) >= min_points
    sigma = np.hypot(noise_share * hand_px, FLOOR_PX)[..., None]
    return np.where(usable, np.nan_to_num(confidence) / sigma**2, 0.0)


def fps_of(videos: Sequence[VideoHands]) -> Tensor:
    """(2 M,) frame rate of every hand of `own_views`."""
    return torch.tensor([v.fps for v in videos for _ in range(2)], dtype=torch.float64)


def own_views(skeleton: HandSkeleton, videos: Sequence[VideoHands]) -> HandViews:
    """Every video's two hands, (2 M, T) padded by their last frame, each seen by its own view."""
    length = max(v.frames for v in videos)

    def padded(values: Tensor) -> Tensor:
        last = values[:, -1:].expand(-1, length - values.shape[1], *values.shape[2:])
        return torch.cat([values, last], dim=1)

    def batch(name: str) -> Tensor:
        return torch.cat([padded(torch.as_tensor(getattr(v, name))) for v in videos])

    lengths = torch.tensor([v.frames for v in videos for _ in range(2)])
    valid = torch.arange(length) < lengths[:, None]
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
    skeleton: HandSkeleton, videos: Sequence[VideoHands], timeline: Timeline
) -> HandViews:
    """(2, N): the hands common to all videos at the reference's frames, seen by every video."""
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
        valid=torch.ones(weight.shape[:2], dtype=torch.bool),
    )


def _common_side(side: int, videos: Sequence[VideoHands], timeline: Timeline) -> list[Tensor]:
    columns: list[list[Tensor]] = [[] for _ in range(5)]
    for v, video in enumerate(videos):
        at = timeline.from_reference[v]
        xy, weight = sample_keypoints(video.xy_px[side], video.weight[side], at)
        trusted = weight * timeline.confidence[v][:, None]
        row = (
            sample_rotations(video.R_forearm[side][:, None], at)[:, 0],
            sample(video.wrist_m[side], at),
            torch.as_tensor(xy),
            torch.as_tensor(trusted),
            sample_rotations(video.R_body[side][:, None], at)[:, 0],
        )
        for column, value in zip(columns, row, strict=True):
            column.append(value)
    *parts, R_body = (torch.stack(column, dim=1) for column in columns)
    trust = torch.as_tensor(timeline.confidence.T) + 1e-6
    return [*parts, mean(R_body, trust, dim=1)]


def common_at(common: HandState, videos: Sequence[VideoHands], timeline: Timeline) -> CommonHand:
    """The common hands (2, N) at the frames of every video, (2 M, T); trust 0 where unmatched.

    An unmatched frame takes the nearest matched one as its start.
    """
    length = max(v.frames for v in videos)
    count = common.angles.shape[1]
    R, angles, trust = [], [], []
    for v, to_reference in enumerate(timeline.to_reference):
        known = np.nonzero(np.isfinite(to_reference))[0]
        frames = np.arange(length)
        at = np.interp(frames, known, to_reference[known]) if len(known) else np.zeros(length)
        sure = np.interp(
            np.clip(at, 0, count - 1), np.arange(count), timeline.confidence[v]
        ) * np.isin(frames, known)
        for side in range(2):
            R.append(sample_rotations(common.R_wrist[side][:, None], at)[:, 0])
            angles.append(sample(common.angles[side], at))
            trust.append(torch.as_tensor(sure))
    return CommonHand(torch.stack(R), torch.stack(angles), torch.stack(trust))
