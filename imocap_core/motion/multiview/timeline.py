"""Between the reference video's frames and every other video's frames."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from imocap_core.rotations import exp, log

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Timeline:
    """Where each video's frames are on the reference's axis, and back.

    Attributes:
        to_reference: per video (T_v,) fractional reference frame, NaN where unmatched.
        from_reference: (M, N) fractional frame of each video at each reference frame, NaN outside.
        confidence: (M, N) in [0, 1], 0 where a video shows nothing of that reference frame.
    """

    to_reference: list[Array]
    from_reference: Array
    confidence: Array


def make_timeline(maps: list[Array], confidences: list[Array], frames: int) -> Timeline:
    """Invert monotone maps (T_v,) onto ``frames`` reference frames.

    Where several frames share a reference frame (a hold) the middle one stands for it.
    """
    inverse = np.full((len(maps), frames), np.nan)
    confidence = np.zeros((len(maps), frames))
    for v, (to_reference, trust) in enumerate(zip(maps, confidences, strict=True)):
        known = np.isfinite(to_reference)
        if not known.any():
            continue
        own = np.nonzero(known)[0].astype(float)
        target = np.maximum.accumulate(to_reference[known])
        unique, group = np.unique(target, return_inverse=True)
        middle = np.bincount(group, own) / np.bincount(group)
        trust_at = np.bincount(group, trust[known]) / np.bincount(group)
        grid = np.arange(frames, dtype=float)
        inside = (grid >= unique[0] - 0.5) & (grid <= unique[-1] + 0.5)
        inverse[v] = np.where(inside, np.interp(grid, unique, middle), np.nan)
        confidence[v] = np.where(inside, np.interp(grid, unique, trust_at), 0.0)
    return Timeline([m.copy() for m in maps], inverse, confidence)


def sample_rotations(R: Tensor, at: Array) -> Tensor:
    """Rotations (T, J, 3, 3) at fractional frames (N,), geodesically; NaN takes the nearest end."""
    low, high, share = _split(at, len(R), R)
    turn = log(R[low].transpose(-1, -2) @ R[high])
    return R[low] @ exp(turn * share[:, None, None])


def sample(values: Tensor, at: Array) -> Tensor:
    """Values (T, ...) at fractional frames (N,), linearly; NaN takes the nearest end."""
    low, high, share = _split(at, len(values), values)
    share = share.reshape(-1, *[1] * (values.ndim - 1))
    return values[low] * (1 - share) + values[high] * share


def sample_keypoints(xy_px: Array, weight: Array, at: Array) -> tuple[Array, Array]:
    """Keypoints (T, K, 2) and weights (T, K) at fractional frames (N,).

    A keypoint missing on one side is taken from the other at half weight; NaN times weigh 0.
    """
    known = np.isfinite(at)
    safe = np.clip(np.where(known, at, 0.0), 0, len(xy_px) - 1)
    low = np.minimum(np.floor(safe).astype(int), max(len(xy_px) - 2, 0))
    high = np.minimum(low + 1, len(xy_px) - 1)
    share = (safe - low)[:, None]
    usable = (weight > 0) & np.isfinite(xy_px).all(-1)
    mix_low = np.where(usable[low], 1 - share, 0.0)
    mix_high = np.where(usable[high], share, 0.0)
    total = mix_low + mix_high
    xy = np.nan_to_num(xy_px)
    blend = mix_low[..., None] * xy[low] + mix_high[..., None] * xy[high]
    mixed = np.where(total > 0.3, total, 0.0)
    value = blend / np.maximum(total, 1e-9)[..., None]
    strength = (mix_low * weight[low] + mix_high * weight[high]) * (mixed > 0)
    return value, strength * known[:, None]


def _split(at: Array, frames: int, like: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """The frames (N,) before and after each time, and how far it lies between them."""
    safe = np.clip(np.nan_to_num(at, nan=0.0), 0, frames - 1)
    low = np.minimum(np.floor(safe).astype(int), max(frames - 2, 0))
    return (
        torch.as_tensor(low, device=like.device),
        torch.as_tensor(np.minimum(low + 1, frames - 1), device=like.device),
        torch.as_tensor(safe - low).to(like),
    )
