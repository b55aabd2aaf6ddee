"""A whole video through the network: windows at about its frame rate, blended to every frame.

A video of 60 frames a second is read as four interleaved ones of 15, and so on. Windows overlap by
two thirds; what they say is turned back into the camera's axes and blended. Every window is also
read in a mirror, and the two answers are averaged.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from imocap_core.conventions import SMPL_JOINTS, mirror_indices
from imocap_core.lifter.network import RATE_HZ, WINDOW, Answer, Lifter
from imocap_core.lifter.points import COMMON, MIRROR
from imocap_core.lifter.rays import look_at_person
from imocap_core.lifter.stitch import one_alternative

HOP = WINDOW // 3
CHUNK = 64  # windows answered at once
FLIP = torch.tensor([-1.0, 1.0, 1.0])  # left is right in a mirror
POINTS, JOINTS = list(MIRROR), list(mirror_indices(SMPL_JOINTS))

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Lifted:
    """What the network says of a video of T frames, in the axes of its rays' camera.

    Attributes:
        joints: (T, 24, 3) SMPL's joints in metres relative to the pelvis.
        sigma_m: (T, 24) root mean square distance from the truth, as the network believes.
        alternative: (T, 24, 3) another motion that looks alike: a depth read the other way.
        seen: (T,) bool, whether any point was seen in the frame.
    """

    joints: Array
    sigma_m: Array
    alternative: Array
    seen: NDArray[np.bool_]


def lift(network: Lifter, rays: Array, confidence: Array, fps: float) -> Lifted:
    """3D joints of every frame.

    Args:
        rays: (T, 33, 2) ``(x - c) / f`` of the common points; confidence: (T, 33), 0 where missing.
        fps: frames a second.

    ValueError names every argument that is wrong.
    """
    _check(rays, confidence, fps)
    frames = len(rays)
    stride = max(1, round(fps / RATE_HZ))
    rows = [r for phase in range(min(stride, frames)) for r in window_rows(frames, stride, phase)]
    at = torch.as_tensor(np.stack(rows))
    inside = (at >= 0) & (at < frames)
    where = at.clamp(0, frames - 1)
    xy = torch.as_tensor(rays, dtype=torch.float32)[where]
    trust = torch.as_tensor(confidence, dtype=torch.float32)[where] * inside[..., None]
    answer = _answer(network, xy, trust)
    share = _share(inside)
    joints = _blend(answer.joints, share, where, frames)
    variance = _blend(answer.log_variance.exp()[..., None], share, where, frames)[..., 0]
    first = at[:, 0] % stride == at[0, 0] % stride  # one phase is enough for the alternative
    other = one_alternative(answer.joints[first], answer.alternatives[first], HOP)
    coarse = _blend(other, share[first], where[first], frames)
    told = np.unique(where[first][inside[first]].numpy())
    alternative = _between(coarse[told], told, frames)
    return Lifted(joints, np.sqrt(variance), alternative, np.asarray((confidence > 0).any(1)))


def window_rows(frames: int, stride: int, phase: int) -> list[NDArray[np.int64]]:
    """Frame numbers of the windows over frames phase, phase + stride, ...; those before 0 or from
    ``frames`` on are outside the video. Each frame of the phase is in at least one window."""
    count = (frames - phase + stride - 1) // stride
    last = count - WINDOW
    starts = [(last + 1) // 2] if last < 0 else range(0, last + HOP, HOP)
    return [phase + stride * (start + np.arange(WINDOW)) for start in starts]


def _answer(network: Lifter, xy: Tensor, trust: Tensor) -> Answer:
    """In the camera's axes, chunk by chunk: of the windows and of their mirror images."""
    parts = []
    with torch.inference_mode():
        for begin in range(0, len(xy), CHUNK):
            rays, own = xy[begin : begin + CHUNK], trust[begin : begin + CHUNK]
            as_seen = _told(network, rays, own)
            in_mirror = _told(network, rays[:, :, POINTS] * FLIP[:2], own[:, :, POINTS])
            parts.append(_both(as_seen, in_mirror))
    return Answer(
        *(
            torch.cat([getattr(p, name) for p in parts])
            for name in ("joints", "log_variance", "alternatives", "logits")
        )
    )


def _told(network: Lifter, rays: Tensor, trust: Tensor) -> Answer:
    seen = look_at_person(rays, trust)
    told, R = network(seen.features), seen.R_turned_from_cam
    return Answer(
        torch.einsum("bji,blkj->blki", R, told.joints),
        told.log_variance,
        torch.einsum("bji,blhkj->blhki", R, told.alternatives),
        told.logits,
    )


def _both(as_seen: Answer, in_mirror: Answer) -> Answer:
    """The mean of two answers, the second one turned back; the alternatives of both."""
    joints, others = in_mirror.joints[:, :, JOINTS], in_mirror.alternatives[..., JOINTS, :]
    return Answer(
        (as_seen.joints + joints * FLIP) / 2,
        (as_seen.log_variance + in_mirror.log_variance[:, :, JOINTS]) / 2,
        torch.cat([as_seen.alternatives, others * FLIP], 2),
        torch.cat([as_seen.logits, in_mirror.logits], 1),
    )


def _share(inside: Tensor) -> Tensor:
    """(B, L): the middle of a window knows most; frames outside the video nothing."""
    middle = (WINDOW - 1) / 2
    away = (torch.arange(WINDOW) - middle).abs() / middle
    return (1.05 - away) * inside


def _blend(values: Tensor, share: Tensor, where: Tensor, frames: int) -> Array:
    """Weighted means (frames, ...) of values (B, L, ...) by frame."""
    flat, weight = values.flatten(0, 1), share.flatten()
    total = torch.zeros(frames).index_add_(0, where.flatten(), weight)
    weighted = flat * weight.view(-1, *[1] * (flat.ndim - 1))
    found = torch.zeros(frames, *flat.shape[1:]).index_add_(0, where.flatten(), weighted)
    mean = found / total.clamp_min(1e-9).view(-1, *[1] * (flat.ndim - 1))
    return mean.double().numpy()


def _between(values: Array, at: NDArray[np.int64], frames: int) -> Array:
    """Linear in time from the frames ``at`` to all frames, held at the ends."""
    flat = values.reshape(len(values), -1)
    every = np.arange(frames)
    found = np.stack([np.interp(every, at, column) for column in flat.T], axis=1)
    return found.reshape(frames, *values.shape[1:])


def _check(rays: Array, confidence: Array, fps: float) -> None:
    faults = []
    if rays.ndim != 3 or rays.shape[1:] != (len(COMMON), 2) or len(rays) == 0:
        faults.append(f"rays: expected (T, {len(COMMON)}, 2), got {rays.shape}")
    elif confidence.shape != rays.shape[:2]:
        faults.append(f"confidence: expected {rays.shape[:2]}, got {confidence.shape}")
    elif not np.isfinite(rays).all() or not np.isfinite(confidence).all():
        faults.append("rays, confidence: expected finite numbers (0 where missing), got NaN")
    if not fps > 0:
        faults.append(f"fps: expected more than 0, got {fps}")
    if faults:
        raise ValueError("; ".join(faults))
