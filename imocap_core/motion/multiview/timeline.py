"""Correspondences between the reference's frames and every video's; motions on the common axis.

Motions resampled from their own frames to the time axis that all videos share. The axis is the
synchronisation's phase (imocap_core/sync/time_axis.py), seconds of the reference. On it one grid of
even steps spans all videos; a video is sampled at the frames of these phases. Before its first and
after its last frame the nearest end is repeated, and `inside` is False.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from imocap_core.rotations import exp, log, unwrap


@dataclass(frozen=True)
class Timeline:
    """Frames of each video at the reference's frames, and back.

    Attributes:
        to_reference: per video (T_v,) fractional reference frame, NaN where unmatched.
        from_reference: (M, N) fractional frame of each video at each reference frame, NaN outside.
        confidence: (M, N) in [0, 1], 0 where a video has no match of that reference frame.
    """

    to_reference: list[Float[np.ndarray, " _"]]
    from_reference: Float[np.ndarray, "M N"]
    confidence: Float[np.ndarray, "M N"]


@dataclass(frozen=True)
class BeyondReference:
    """Frames of a video that the reference does not show and others do.

    Attributes:
        position: (T,) fractional frame on the reference's axis, below 0 or beyond its last frame;
            NaN elsewhere.
        confidence: (T,) in [0, 1] that another video shows the same moment; 0 elsewhere.
    """

    position: Float[np.ndarray, " T"]
    confidence: Float[np.ndarray, " T"]


def make_timeline(
    maps: Sequence[Float[np.ndarray, " _"]],
    confidences: Sequence[Float[np.ndarray, " _"]],
    frames: int,
) -> Timeline:
    """Invert monotone maps (T_v,) onto ``frames`` reference frames.

    Of several frames that share a reference frame the middle one is used.
    """
    inverse = np.full((len(maps), frames), np.nan)
    confidence = np.zeros((len(maps), frames))
    for v, (to_reference, trust) in enumerate(zip(maps, confidences, strict=True)):
        matched = np.isfinite(to_reference)
        if not matched.any():
            continue
        index = np.nonzero(matched)[0].astype(float)
        target = np.maximum.accumulate(to_reference[matched])
        unique, group = np.unique(target, return_inverse=True)
        middle = np.bincount(group, index) / np.bincount(group)
        mean_trust = np.bincount(group, trust[matched]) / np.bincount(group)
        grid = np.arange(frames, dtype=float)
        inside = (grid >= unique[0] - 0.5) & (grid <= unique[-1] + 0.5)
        inverse[v] = np.where(inside, np.interp(grid, unique, middle), np.nan)
        confidence[v] = np.where(inside, np.interp(grid, unique, mean_trust), 0.0)
    return Timeline([m.copy() for m in maps], inverse, confidence)


def sample_rotations(
    R: Float[Tensor, "T J 3 3"], position: Float[np.ndarray, " N"]
) -> Float[Tensor, "N J 3 3"]:
    """Rotations at fractional frames, geodesically; NaN takes the first frame."""
    low, high, share = _split(position, len(R), R)
    turn = log(R[low].transpose(-1, -2) @ R[high])
    return R[low] @ exp(turn * share[:, None, None])


def sample(
    values: Float[Tensor, "T ..."], position: Float[np.ndarray, " N"]
) -> Float[Tensor, "N ..."]:
    """Values at fractional frames, linearly; NaN takes the first frame."""
    low, high, share = _split(position, len(values), values)
    share = share.reshape(-1, *[1] * (values.ndim - 1))
    return values[low] * (1 - share) + values[high] * share


def sample_keypoints(
    points: Float[np.ndarray, "T K D"],
    weight: Float[np.ndarray, "T K"],
    position: Float[np.ndarray, " N"],
) -> tuple[Float[np.ndarray, "N K D"], Float[np.ndarray, "N K"]]:
    """Keypoints (in 2D or 3D) and their weights at fractional frames.

    A keypoint missing on one side is taken from the other at reduced weight; NaN times weigh 0.
    """
    matched = np.isfinite(position)
    safe = np.clip(np.where(matched, position, 0.0), 0, len(points) - 1)
    low = np.minimum(np.floor(safe).astype(int), max(len(points) - 2, 0))
    high = np.minimum(low + 1, len(points) - 1)
    share = (safe - low)[:, None]
    usable = (weight > 0) & np.isfinite(points).all(-1)
    mix_low = np.where(usable[low], 1 - share, 0.0)
    mix_high = np.where(usable[high], share, 0.0)
    total = mix_low + mix_high
    xy = np.nan_to_num(points)
    blend = mix_low[..., None] * xy[low] + mix_high[..., None] * xy[high]
    mixed = np.where(total > 0.3, total, 0.0)
    value = blend / np.maximum(total, 1e-9)[..., None]
    strength = (mix_low * weight[low] + mix_high * weight[high]) * (mixed > 0)
    return value, strength * matched[:, None]


def _split(position: np.ndarray, frames: int, template: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """The frames (N,) before and after each position, and its share of the way between them."""
    safe = np.clip(np.nan_to_num(position, nan=0.0), 0, frames - 1)
    low = np.minimum(np.floor(safe).astype(int), max(frames - 2, 0))
    return (
        torch.as_tensor(low, device=template.device),
        torch.as_tensor(np.minimum(low + 1, frames - 1), device=template.device),
        torch.as_tensor(safe - low).to(template),
    )


@dataclass(frozen=True)
class FramePositions:
    """Where N moments lie among a video's used frames.

    Attributes:
        position: (N,) fractional index of its used frames.
        inside: (N,) False before its first and after its last frame, where its nearest end is used.
    """

    position: Float[np.ndarray, " N"]
    inside: Bool[np.ndarray, " N"]


def common_grid(phases_s: Sequence[Float[np.ndarray, " _"]], fps: float) -> Float[np.ndarray, " N"]:
    """Even steps, 1 / fps apart, over the phases of all videos, seconds of the reference.

    The grid contains phase 0 whenever that lies within. NaN phases are ignored.
    """
    every = np.concatenate([phase[np.isfinite(phase)] for phase in phases_s])
    first, last = np.ceil(every.min() * fps - 1e-6), np.floor(every.max() * fps + 1e-6)
    return np.asarray((np.arange(first, last + 1) + 0.0) / fps)


def frame_positions(
    phase_s: Float[np.ndarray, " T"], grid_s: Float[np.ndarray, " N"]
) -> FramePositions:
    """Positions of the moments ``grid_s`` in a video of phases that never fall; NaN is unknown.

    Several frames of equal phase are stepped over at once.

    Raises:
        ValueError: phases fall.
    """
    finite = np.flatnonzero(np.isfinite(phase_s))
    rising = phase_s[finite]
    if (np.diff(rising) < 0).any():
        raise ValueError("phase_s: expected phases that never fall, got some that do")
    strictly = rising + 1e-9 * np.arange(len(finite))
    position = np.interp(grid_s, strictly, finite.astype(np.float64))
    slack = 1e-6
    inside = (grid_s >= rising[0] - slack) & (grid_s <= rising[-1] + slack)
    return FramePositions(position, inside)


def pose_at(
    theta: Float[np.ndarray, "T D"], position: Float[np.ndarray, " N"]
) -> Float[np.ndarray, "N D"]:
    """Axis-angle poses (D = 3 J, radians) at fractional frames: every joint geodesically."""
    local = exp(torch.as_tensor(theta).reshape(len(theta), -1, 3))
    return unwrap(log(sample_rotations(local, position))).reshape(len(position), -1).numpy()


def values_at(
    values: Float[np.ndarray, "T ..."], position: Float[np.ndarray, " N"]
) -> Float[np.ndarray, "N ..."]:
    """Values at fractional frames, linearly between two."""
    low = np.minimum(np.floor(position).astype(np.int64), max(len(values) - 2, 0))
    high = np.minimum(low + 1, len(values) - 1)
    share = (position - low).reshape(-1, *[1] * (values.ndim - 1))
    return np.asarray((1 - share) * values[low] + share * values[high])
