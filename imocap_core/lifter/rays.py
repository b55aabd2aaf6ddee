"""What the network reads: rays towards the points, seen by a camera turned to the person.

Turning the camera so that its axis passes through the person makes a pose look the same wherever
in the picture it is; the size in rays says how near the person is, so how strong perspective is.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from imocap_core.lifter.points import COMMON

FEATURES = 3 * len(COMMON) + 4
LEAST_DEPTH = 0.1  # of a ray's direction: points further than 84 degrees to the side are not used
MOST = 6.0  # in units of the person's size: further away nothing is told apart


@dataclass(frozen=True)
class Seen:
    """features (B, L, FEATURES); R_turned_from_cam (B, 3, 3)."""

    features: Tensor
    R_turned_from_cam: Tensor


def look_at_person(rays: Tensor, confidence: Tensor) -> Seen:
    """Windows of rays as the network reads them.

    Args:
        rays: (B, L, K, 2) ``(x - c) / f``, K as `COMMON`; confidence: (B, L, K) 0 where missing.
    """
    R = _turn(rays, confidence > 0)
    directions = torch.cat([rays, torch.ones_like(rays[..., :1])], -1)
    turned = torch.einsum("bij,blkj->blki", R, directions)
    seen = (confidence > 0) & (turned[..., 2] > LEAST_DEPTH)
    xy = turned[..., :2] / turned[..., 2:].clamp_min(LEAST_DEPTH)
    middle = _median(xy, seen)
    local = xy - middle[:, :, None]
    radius = local.norm(dim=-1).masked_fill(~seen, torch.nan).flatten(1).nanmedian(1).values
    size = radius.nan_to_num(0.1).clamp_min(1e-4)[:, None, None]
    there = seen.any(-1, keepdim=True).to(rays)
    trust = torch.where(seen, confidence, 0.0)
    local = torch.where(seen[..., None], (local / size[..., None]).clamp(-MOST, MOST), 0.0)
    path = (middle / size).clamp(-MOST, MOST) * there
    nearness = (size / 0.1).log() * there
    parts = [local.flatten(2), trust, path, nearness, there]
    return Seen(torch.cat(parts, -1), R)


def _turn(rays: Tensor, seen: Tensor) -> Tensor:
    """R_turned_from_cam (B, 3, 3): about the picture's y, then its x; never about its axis."""
    hidden = ~seen[..., None].expand_as(rays)
    x, y = rays.masked_fill(hidden, torch.nan).flatten(1, 2).nanmedian(1).values.nan_to_num(0.0).T
    side = (1 + x * x).sqrt()
    pan_c, pan_s = 1 / side, x / side
    whole = (side * side + y * y).sqrt()
    tilt_c, tilt_s = side / whole, y / whole
    none = torch.zeros_like(x)
    rows = [
        torch.stack([pan_c, none, -pan_s], -1),
        torch.stack([-tilt_s * pan_s, tilt_c, -tilt_s * pan_c], -1),
        torch.stack([tilt_c * pan_s, tilt_s, tilt_c * pan_c], -1),
    ]
    return torch.stack(rows, -2)


def _median(xy: Tensor, seen: Tensor) -> Tensor:
    """(B, L, 2) of each frame's points; 0 where there is none."""
    hidden = ~seen[..., None].expand_as(xy)
    return xy.masked_fill(hidden, torch.nan).nanmedian(-2).values.nan_to_num(0.0)
