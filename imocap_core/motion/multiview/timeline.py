"""Correspondences between the reference video's frames and every other video's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.rotations import exp, log


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
