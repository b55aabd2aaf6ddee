"""Inference on a whole video: overlapping windows at about the network's frame rate, blended.

One alternative motion from the hypotheses of overlapping windows (Viterbi). The hypotheses of a
window have no particular order. The cheapest path selects one of each window so that overlapping
windows agree and the motion differs from the mean output.

A video of 60 frames a second is processed as four interleaved ones of 15, and so on. Windows
overlap by two thirds; their outputs are rotated back into camera axes and blended. Test-time
augmentation: every window is also processed mirrored, and the two outputs are averaged.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int64
from torch import Tensor

from imocap_core.conventions import SMPL_JOINTS, mirror_indices
from imocap_core.lifter.lifter_network import (
    COMMON,
    MIRROR,
    RATE_HZ,
    WINDOW,
    Lifter,
    LifterOutput,
    person_centred_features,
)

DIFFERENCE = 0.5  # weight of the distance from the mean output, relative to that in an overlap


def stitch_alternatives(
    joints: Float[Tensor, "B L 24 3"], alternatives: Float[Tensor, "B L H 24 3"], hop: int
) -> Float[Tensor, "B L 24 3"]:
    """One alternative of each window, consistent from window to window.

    Args:
        joints: mean outputs. alternatives: hypotheses. hop: frames between consecutive windows.
    """
    distance = (alternatives - joints[:, :, None]).norm(dim=-1).mean((1, 3))
    unary = -DIFFERENCE * distance
    total, back = unary[0], []
    for before, after, cost in zip(alternatives[:-1], alternatives[1:], unary[1:], strict=True):
        a, b = before[hop:], after[: len(after) - hop]
        step = (a[:, :, None] - b[:, None]).norm(dim=-1).mean((0, 3))
        best = (total[:, None] + step).min(0)
        total = best.values + cost
        back.append(best.indices)
    chosen = [int(total.argmin())]
    for pointer in reversed(back):
        chosen.append(int(pointer[chosen[-1]]))
    picked = torch.tensor(chosen[::-1], device=joints.device)
    return alternatives[torch.arange(len(picked), device=joints.device), :, picked]


HOP = WINDOW // 3
CHUNK = 64  # windows in one pass of the network
FLIP = torch.tensor([-1.0, 1.0, 1.0])  # of coordinates in a mirrored picture
MIRRORED_POINTS, MIRRORED_JOINTS = list(MIRROR), list(mirror_indices(SMPL_JOINTS))


@dataclass(frozen=True)
class Lifted:
    """3D joints lifted from a video's 2D keypoints, in the axes of the rays' camera.

    Attributes:
        joints: SMPL's joints in metres relative to the pelvis.
        sigma_m: predicted root mean square error of each joint.
        alternative: a second hypothesis with a similar projection, as depth is ambiguous.
        visible: whether the frame shows any point.
    """

    joints: Float[np.ndarray, "T 24 3"]
    sigma_m: Float[np.ndarray, "T 24"]
    alternative: Float[np.ndarray, "T 24 3"]
    visible: Bool[np.ndarray, " T"]


def lift(
    network: Lifter,
    rays: Float[np.ndarray, "..."],
    confidence: Float[np.ndarray, "..."],
    fps: float,
) -> Lifted:
    """2D-to-3D lifting: the 3D joints of every frame.

    Args:
        rays: (T, 33, 2) ``(x - c) / f`` of the common points.
        confidence: (T, 33), 0 where missing.
        fps: frames per second.

    Raises:
        ValueError: names every argument that is wrong.
    """
    _check(rays, confidence, fps)
    frames = len(rays)
    stride = max(1, round(fps / RATE_HZ))
    rows = [r for phase in range(min(stride, frames)) for r in window_rows(frames, stride, phase)]
    device = network.first.weight.device
    window = torch.as_tensor(np.stack(rows), device=device)
    inside = (window >= 0) & (window < frames)
    frame = window.clamp(0, frames - 1)
    xy = torch.as_tensor(rays, dtype=torch.float32, device=device)[frame]
    trust = (
        torch.as_tensor(confidence, dtype=torch.float32, device=device)[frame] * inside[..., None]
    )
    output = _outputs(network, xy, trust)
    weight = _blending_weights(inside)
    joints = _blend(output.joints, weight, frame, frames)
    variance = _blend(output.log_variance.exp()[..., None], weight, frame, frames)[..., 0]
    first = window[:, 0] % stride == window[0, 0] % stride  # one phase is enough here
    stitched = stitch_alternatives(output.joints[first], output.alternatives[first], HOP)
    coarse = _blend(stitched, weight[first], frame[first], frames)
    covered = np.unique(frame[first][inside[first]].cpu().numpy())
    alternative = _interpolate(coarse[covered], covered, frames)
    return Lifted(joints, np.sqrt(variance), alternative, np.asarray((confidence > 0).any(1)))


def window_rows(frames: int, stride: int, phase: int) -> list[Int64[np.ndarray, " L"]]:
    """Frame numbers of the windows over frames phase, phase + stride, ...

    Numbers below 0 or from ``frames`` on are outside the video. Each frame of the phase is in at
    least one window.
    """
    count = (frames - phase + stride - 1) // stride
    last = count - WINDOW
    starts = [(last + 1) // 2] if last < 0 else range(0, last + HOP, HOP)
    return [phase + stride * (start + np.arange(WINDOW)) for start in starts]


def _outputs(
    network: Lifter, xy: Float[Tensor, "B L K 2"], trust: Float[Tensor, "B L K"]
) -> LifterOutput:
    """Of the windows and of their mirror images, in camera axes, chunk by chunk."""
    parts = []
    with torch.inference_mode():
        for begin in range(0, len(xy), CHUNK):
            rays, weight = xy[begin : begin + CHUNK], trust[begin : begin + CHUNK]
            plain = _output(network, rays, weight)
            mirrored = _output(
                network,
                rays[:, :, MIRRORED_POINTS] * FLIP[:2].to(rays),
                weight[:, :, MIRRORED_POINTS],
            )
            parts.append(_average(plain, mirrored))
    return LifterOutput(
        *(
            torch.cat([getattr(p, name) for p in parts])
            for name in ("joints", "log_variance", "alternatives", "logits")
        )
    )


def _output(
    network: Lifter, rays: Float[Tensor, "B L K 2"], trust: Float[Tensor, "B L K"]
) -> LifterOutput:
    """The network's output, rotated back into camera axes."""
    centred = person_centred_features(rays, trust)
    output, R = network(centred.features), centred.R_turned_from_cam
    return LifterOutput(
        torch.einsum("bji,blkj->blki", R, output.joints),
        output.log_variance,
        torch.einsum("bji,blhkj->blhki", R, output.alternatives),
        output.logits,
    )


def _average(plain: LifterOutput, mirrored: LifterOutput) -> LifterOutput:
    """The mean of both outputs, the second one mirrored back; the alternatives of both."""
    joints, others = (
        mirrored.joints[:, :, MIRRORED_JOINTS],
        mirrored.alternatives[..., MIRRORED_JOINTS, :],
    )
    flip = FLIP.to(joints)
    return LifterOutput(
        (plain.joints + joints * flip) / 2,
        (plain.log_variance + mirrored.log_variance[:, :, MIRRORED_JOINTS]) / 2,
        torch.cat([plain.alternatives, others * flip], 2),
        torch.cat([plain.logits, mirrored.logits], 1),
    )


def _blending_weights(inside: Bool[Tensor, "B L"]) -> Float[Tensor, "B L"]:
    """Largest in the middle of a window, where estimates are best; 0 outside the video."""
    middle = (WINDOW - 1) / 2
    away = (torch.arange(WINDOW, device=inside.device) - middle).abs() / middle
    return (1.05 - away) * inside


def _blend(
    values: Float[Tensor, "B L *item"],
    weight: Float[Tensor, "B L"],
    frame: Int64[Tensor, "B L"],
    frames: int,
) -> Float[np.ndarray, "T *item"]:
    """Weighted means of the values of each frame."""
    flat, share = values.flatten(0, 1), weight.flatten()
    total = flat.new_zeros(frames).index_add_(0, frame.flatten(), share)
    weighted = flat * share.view(-1, *[1] * (flat.ndim - 1))
    summed = flat.new_zeros(frames, *flat.shape[1:]).index_add_(0, frame.flatten(), weighted)
    mean = summed / total.clamp_min(1e-9).view(-1, *[1] * (flat.ndim - 1))
    return mean.double().cpu().numpy()


def _interpolate(
    values: Float[np.ndarray, "N *item"], at_frames: Int64[np.ndarray, " N"], frames: int
) -> Float[np.ndarray, "T *item"]:
    """Linear interpolation over time to all frames, constant beyond the ends."""
    flat = values.reshape(len(values), -1)
    every = np.arange(frames)
    columns = np.stack([np.interp(every, at_frames, column) for column in flat.T], axis=1)
    return columns.reshape(frames, *values.shape[1:])


def _check(rays: np.ndarray, confidence: np.ndarray, fps: float) -> None:
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
