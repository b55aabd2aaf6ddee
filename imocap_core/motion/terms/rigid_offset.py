"""Per-frame rigid offset of a performance against the common motion.

Whoever repeats an action stands elsewhere and faces elsewhere, a little, at every moment. In a view
of the common motion that is six numbers a frame, ``d = (rotation, translation)``, small with a
given spread. They are minimised out of each frame's residuals (variable projection, `inner_solve`),
so the objective stays a function of the common motion alone and its normal equations lose what the
offsets could explain (a Schur complement of 6 x 6).
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.rotations import exp, hat

RIGID = 6


def with_rigid_offset(
    xyz: Float[Tensor, "B T K 3"], pivot: Float[Tensor, "B T 3"], d: Float[Tensor, "B T 6"]
) -> Float[Tensor, "B T K 3"]:
    """Points rotated about the pivot, then translated; rad and metres."""
    arms = xyz - pivot[..., None, :]
    rotated = torch.einsum("btij,btkj->btki", exp(d[..., :3]), arms)
    return rotated + (pivot + d[..., 3:])[..., None, :]


def by_rigid_offset(
    by_point: Float[Tensor, "B T K 2 3"],
    xyz: Float[Tensor, "B T K 3"],
    pivot: Float[Tensor, "B T 3"],
    d: Float[Tensor, "B T 6"],
) -> Float[Tensor, "B T K 2 6"]:
    """Derivative of residuals by the offset, at points xyz that already have it."""
    arms = xyz - (pivot + d[..., 3:])[..., None, :]
    return torch.cat([by_point @ -hat(arms), by_point], -1)
