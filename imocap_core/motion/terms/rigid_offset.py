"""Performances are never rigid copies: each one's body may stray, turned and shifted as a whole.

Whoever repeats an action stands elsewhere and faces elsewhere, a little, at every moment. In a view
of the common motion that is six numbers a frame, ``d = (turn, shift)``, small with a known spread.
They are minimised out of each frame's residuals (variable projection, `settling`), so the objective
stays a function of the common motion alone and its normal equations lose what strays could explain
(a Schur complement of 6 x 6).
"""

import torch
from torch import Tensor

from imocap_core.rotations import exp, hat

RIGID = 6


def strayed(xyz: Tensor, pivot: Tensor, d: Tensor) -> Tensor:
    """Points (B, T, K, 3) turned about the pivot (B, T, 3) and shifted by d (B, T, 6)."""
    arms = xyz - pivot[..., None, :]
    turned = torch.einsum("btij,btkj->btki", exp(d[..., :3]), arms)
    return turned + (pivot + d[..., 3:])[..., None, :]


def by_stray(by_point: Tensor, xyz: Tensor, pivot: Tensor, d: Tensor) -> Tensor:
    """(B, T, K, 2, 6) derivative of residuals by d, at strayed points xyz (B, T, K, 3)."""
    arms = xyz - (pivot + d[..., 3:])[..., None, :]
    return torch.cat([by_point @ -hat(arms), by_point], -1)
