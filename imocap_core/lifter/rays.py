"""Input features of the network: rays to the points in person-centred camera axes.

Rotating the camera so that its optical axis passes through the person makes the features
independent of the person's position in the picture. The person's size in rays is a feature of its
own: it determines the distance, and so how strong the perspective is.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from imocap_core.lifter.points import COMMON

FEATURES = 3 * len(COMMON) + 4
LEAST_DEPTH = 0.1  # of a ray's direction: points further than 84 degrees to the side are not used
MOST = 6.0  # coordinates are clipped here, in units of the person's size


@dataclass(frozen=True)
class LifterInput:
    """Features of B windows of L frames, and the camera rotation that centres the person."""

    features: Float[Tensor, "B L F"]
    R_turned_from_cam: Float[Tensor, "B 3 3"]


def person_centred_features(
    rays: Float[Tensor, "B L K 2"], confidence: Float[Tensor, "B L K"]
) -> LifterInput:
    """Features of windows of rays.

    Args:
        rays: ``(x - c) / f`` of the points `COMMON`. confidence: 0 where missing.
    """
    R = _centring_rotation(rays, confidence > 0)
    directions = torch.cat([rays, torch.ones_like(rays[..., :1])], -1)
    turned = torch.einsum("bij,blkj->blki", R, directions)
    visible = (confidence > 0) & (turned[..., 2] > LEAST_DEPTH)
    xy = turned[..., :2] / turned[..., 2:].clamp_min(LEAST_DEPTH)
    middle = _median(xy, visible)
    local = xy - middle[:, :, None]
    radius = local.norm(dim=-1).masked_fill(~visible, torch.nan).flatten(1).nanmedian(1).values
    size = radius.nan_to_num(0.1).clamp_min(1e-4)[:, None, None]
    present = visible.any(-1, keepdim=True).to(rays)
    trust = torch.where(visible, confidence, 0.0)
    local = torch.where(visible[..., None], (local / size[..., None]).clamp(-MOST, MOST), 0.0)
    path = (middle / size).clamp(-MOST, MOST) * present
    nearness = (size / 0.1).log() * present
    parts = [local.flatten(2), trust, path, nearness, present]
    return LifterInput(torch.cat(parts, -1), R)


def _centring_rotation(
    rays: Float[Tensor, "B L K 2"], visible: Bool[Tensor, "B L K"]
) -> Float[Tensor, "B 3 3"]:
    """R_turned_from_cam: pan, then tilt, without roll, towards the median ray."""
    hidden = ~visible[..., None].expand_as(rays)
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


def _median(xy: Float[Tensor, "B L K 2"], visible: Bool[Tensor, "B L K"]) -> Float[Tensor, "B L 2"]:
    """Median of each frame's points; 0 where there is none."""
    hidden = ~visible[..., None].expand_as(xy)
    return xy.masked_fill(hidden, torch.nan).nanmedian(-2).values.nan_to_num(0.0)
