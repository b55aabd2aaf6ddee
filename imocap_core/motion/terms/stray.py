"""Performances are never rigid copies: each one's body may stray, turned and shifted as a whole.

Whoever repeats an action stands elsewhere and faces elsewhere, a little, at every moment. In a view
of the common motion that is six numbers a frame, ``d = (turn, shift)``, small with a known spread.
They are minimised out of each frame's residuals (variable projection), so the objective stays a
function of the common motion alone and its normal equations lose what strays could explain (a
Schur complement of 6 x 6).
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from imocap_core.rotations import exp, hat

INNER_STEPS = 30  # at most
SETTLED = 1e-4  # rad, m: strays that move less have settled
RIGID = 6


@dataclass(frozen=True)
class Pull:
    """Linearised reprojection of strayed points.

    Attributes:
        residual: (B, T, K, 2) weighted pixels; by_point: (B, T, K, 2, 3) its derivative by the
            point in the state's axes, weighted alike.
    """

    residual: Tensor
    by_point: Tensor


def strayed(xyz: Tensor, pivot: Tensor, d: Tensor) -> Tensor:
    """Points (B, T, K, 3) turned about the pivot (B, T, 3) and shifted by d (B, T, 6)."""
    arms = xyz - pivot[..., None, :]
    turned = torch.einsum("btij,btkj->btki", exp(d[..., :3]), arms)
    return turned + (pivot + d[..., 3:])[..., None, :]


def by_stray(by_point: Tensor, xyz: Tensor, pivot: Tensor, d: Tensor) -> Tensor:
    """(B, T, K, 2, 6) derivative of residuals by d, at strayed points xyz (B, T, K, 3)."""
    arms = xyz - (pivot + d[..., 3:])[..., None, :]
    return torch.cat([by_point @ -hat(arms), by_point], -1)


@torch.no_grad()  # at their optimum the strays' own change does not change the cost
def settle(
    linearised: Callable[[Tensor], Pull], xyz: Tensor, pivot: Tensor, precision: Tensor
) -> tuple[Tensor, Tensor]:
    """The strays of a view that fit its frames best, and how sharply.

    Args:
        linearised: residuals at given points (robust weights included).
        xyz: (B, T, K, 3) points of the common motion; pivot: (B, T, 3) its root.
        precision: (B, T, 6) inverse variances of the strays, 1/rad^2 and 1/m^2.

    Returns:
        d (B, T, 6) and its precision matrix (B, T, 6, 6).
    """
    d = torch.zeros_like(precision)
    for _ in range(INNER_STEPS):
        at = strayed(xyz, pivot, d)
        pull = linearised(at)
        rows = by_stray(pull.by_point, at, pivot, d).flatten(2, 3)
        gradient = (rows.transpose(-1, -2) @ pull.residual.flatten(2)[..., None])[..., 0]
        sharpness = rows.transpose(-1, -2) @ rows + torch.diag_embed(precision)
        step = torch.linalg.solve(sharpness, (gradient + precision * d)[..., None])[..., 0]
        d = d - step
        if float(step.abs().max()) < SETTLED:
            break
    return d, sharpness


def without_strays(full: Tensor, gradient: Tensor, precision: Tensor) -> tuple[Tensor, Tensor]:
    """Normal equations whose last six unknowns are strays, after eliminating them.

    Args:
        full: (B, T, n + 6, n + 6); gradient: (B, T, n + 6); precision: (B, T, 6).

    Returns:
        (B, T, n, n) and (B, T, n).
    """
    own = full[..., -RIGID:, -RIGID:] + torch.diag_embed(precision)
    cross = full[..., :-RIGID, -RIGID:]
    taken = torch.linalg.solve(own, cross.transpose(-1, -2))  # (B, T, 6, n)
    kept = gradient[..., :-RIGID]  # the strays' own gradient is zero where they have settled
    return full[..., :-RIGID, :-RIGID] - cross @ taken, kept
