"""From 2D keypoints to 3D starts: match each frame against the library, then the best path.

Matching alone is ambiguous in depth. Each frame has many candidates; dynamic programming picks
the sequence that agrees with the image and moves least in 3D. A penalty near earlier paths gives
further, different starts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import torch
from jaxtyping import Float, Int
from torch import Tensor

from imocap_core.motion.monocular.library import Library
from imocap_core.robust import geman_mcclure
from imocap_core.rotations import exp

CHUNK, FRAMES = 16384, 32  # templates, and frames, matched at once: 0.1 GB
KEYPOINT_SIGMAS, STEP_SIGMAS = 3.0, 3.0  # Geman-McClure scales of the match and of the path


@dataclass(frozen=True)
class Candidates:
    """The best C library entries of each frame.

    Attributes:
        R_local: (T, C, 24, 3, 3) with the global rotation in camera axes.
        joints: (T, C, 24, 3) metres relative to the root, camera axes.
        scale_px_m: (T, C) pixels a metre; cost: (T, C) unary cost.
    """

    R_local: Float[Tensor, "T C 24 3 3"]
    joints: Float[Tensor, "T C 24 3"]
    scale_px_m: Float[Tensor, "T C"]
    cost: Float[Tensor, "T C"]


def match(
    library: Library,
    xy_px: Float[Tensor, "T K 2"],
    weight: Float[Tensor, "T K"],
    *,
    count: int,
    sigma: float,
) -> Candidates:
    """The ``count`` most likely entries of each frame under weak perspective.

    Args:
        xy_px: finite; weight: confidence, 0 where missing.
        sigma: keypoint misfit in units of the person's image size (RMS spread of keypoints):
            detector noise, bone lengths and the library's coarseness together.
    """
    blocks = zip(xy_px.split(FRAMES), weight.split(FRAMES), strict=True)
    matched = [_match(library, *block, count=count, sigma=sigma) for block in blocks]
    return Candidates(
        *(torch.cat([getattr(x, f.name) for x in matched]) for f in fields(Candidates))
    )


def _match(
    library: Library, xy_px: Tensor, weight: Tensor, *, count: int, sigma: float
) -> Candidates:
    w = torch.complex(xy_px[..., 0], xy_px[..., 1])
    total = weight.sum(1).clamp_min(1e-9)
    centre = (weight * w).sum(1) / total
    w = (w - centre[:, None]) * (weight > 0)
    spread = ((weight * w.abs().square()).sum(1) / total).clamp_min(1e-9)
    first = _best_least_squares(library, w, weight / total[:, None], spread, 8 * count)
    return _rescore(library, first, w, weight, spread, count=count, sigma=sigma)


def _best_least_squares(
    library: Library, w: Tensor, share: Tensor, spread: Tensor, keep: int
) -> Tensor:
    """(T, keep) template indices with the smallest share of unexplained spread.

    For centred observations w and template p, the residual after the best similarity is
    ``1 - |sum c w conj(p)|^2 / (spread_w spread_p)``: three matrix products over all templates.
    """
    best_value = w.real.new_full((len(w), 0), 0.0)
    best_index = torch.zeros((len(w), 0), dtype=torch.long, device=w.device)
    narrow_w, narrow_c = w.to(torch.complex64), share.to(torch.float32)
    weighted = narrow_c * narrow_w
    for start in range(0, len(library.templates), CHUNK):
        p = library.templates[start : start + CHUNK].to(torch.complex64)
        mean = narrow_c.to(torch.complex64) @ p.T
        spread_p = narrow_c @ _square(p).T - _square(mean)
        cross = weighted @ p.conj().T
        value = 1 - _square(cross) / (spread_p.clamp_min(1e-9) * spread[:, None].float())
        index = torch.arange(start, start + len(p), device=w.device).expand(len(w), -1)
        values = torch.cat([best_value.float(), value], 1)
        indices = torch.cat([best_index, index], 1)
        top = values.topk(min(keep, values.shape[1]), dim=1, largest=False)
        best_value, best_index = top.values, indices.gather(1, top.indices)
    return best_index


def _square(z: Tensor) -> Tensor:
    """Squared magnitude of complex numbers, without the square root of ``abs``."""
    return z.real.square().addcmul_(z.imag, z.imag)


def _rescore(
    library: Library,
    index: Tensor,
    w: Tensor,
    weight: Tensor,
    spread: Tensor,
    *,
    count: int,
    sigma: float,
) -> Candidates:
    """Robust similarity (outliers fade), plus priors of pose and of an upright body."""
    p = library.templates[index]
    c = weight[:, None].expand(p.shape[:2] + weight.shape[1:]).clone()
    unit2 = (sigma**2 * spread)[:, None, None]
    for _ in range(4):
        share = c / c.sum(-1, keepdim=True).clamp_min(1e-9)
        mean_p = (share * p).sum(-1, keepdim=True)
        mean_w = (share * w[:, None]).sum(-1, keepdim=True)
        q, v = p - mean_p, w[:, None] - mean_w
        factor = (share * v * q.conj()).sum(-1) / (share * _square(q)).sum(-1).clamp_min(1e-9)
        squared = _square(v - factor[..., None] * q) / unit2
        loss, robust = geman_mcclure(squared, KEYPOINT_SIGMAS)
        c = weight[:, None] * robust
    fit = (weight[:, None] * loss).sum(-1)
    directions = len(library.R_view)
    pose, view = index // directions, index % directions
    roll = factor.angle()
    lean = torch.acos((torch.cos(library.tilt_rad)[view] * torch.cos(roll)).clamp(-1, 1))
    cost = fit + 0.1 * library.pose_cost[pose] + (lean / 0.8).square()
    best = cost.topk(min(count, cost.shape[1]), dim=1, largest=False)
    pose, view, roll, factor = (x.gather(1, best.indices) for x in (pose, view, roll, factor))
    zero = torch.zeros_like(roll)
    R_root = exp(torch.stack([zero, zero, roll], -1)) @ library.R_view[view]
    R_local = library.R_local[pose].clone()
    R_local[:, :, 0] = R_root
    joints = torch.einsum("tcij,tckj->tcki", R_root, library.joints[pose])
    return Candidates(R_local, joints, factor.abs(), best.values)


def best_path(
    candidates: Candidates,
    *,
    step_m: float,
    avoid: Sequence[Float[Tensor, "T 24 3"]] = (),
) -> tuple[Int[Tensor, " T"], float]:
    """The candidate of each frame on the cheapest path, and the path's cost.

    Args:
        step_m: joint movement from one frame to the next that costs 1 per joint (9 at most, so that
            single outliers do not bend the path).
        avoid: joints of earlier paths; entries near them cost more.
    """
    unary = candidates.cost.clone()
    for path in avoid:
        away = (candidates.joints - path[:, None]).square().sum(-1).mean(-1)
        unary = unary + 40.0 * torch.exp(-away / (2 * 0.15**2))
    frames = len(unary)
    total, back = unary[0], []
    for t in range(1, frames):
        flat = candidates.joints[t - 1].flatten(1), candidates.joints[t].flatten(1)
        squared = torch.cdist(*flat).square() / step_m**2
        per_joint = squared / candidates.joints.shape[2]
        move = 24 * geman_mcclure(per_joint, STEP_SIGMAS)[0]
        best = (total[:, None] + move).min(0)
        total = best.values + unary[t]
        back.append(best.indices)
    chosen = [int(total.argmin())]
    for pointer in reversed(back):
        chosen.append(int(pointer[chosen[-1]]))
    return torch.tensor(chosen[::-1], device=unary.device), float(total.min())
