"""Inner solve (variable projection): the rigid offsets that fit a view's frames best.

Plain Gauss-Newton on six unknowns a frame. Every frame is by itself and small, and this runs at
every state that is tried, so it works in the camera's axes, where a projection's derivative has
four entries, and on planes (B, T, K) of one coordinate of all points; what is quadratic in a
frame's rows is one product. The descent of the outer solve (`solver.descent`) would evaluate the
cost of every step besides: the prior keeps these steps from running away without it.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.terms.view import NEAREST_M, View
from imocap_core.robust import geman_mcclure_root
from imocap_core.rotations import exp

INNER_STEPS = 30  # at most
CONVERGED = 1e-4  # rad, m: change of an offset in the last step


@torch.no_grad()  # at their optimum the offsets' change does not change the cost
def solve_rigid_offsets(
    view: View,
    scale: float,
    xyz: Float[Tensor, "B T K 3"],
    pivot: Float[Tensor, "B T 3"],
    precision: Float[Tensor, "B T 6"],
    start: Float[Tensor, "B T 6"] | None = None,
) -> tuple[Float[Tensor, "B T 6"], Float[Tensor, "B T 6 6"]]:
    """Rigid offsets of a view's frames, and their precision matrices.

    Args:
        view: the detected keypoints; scale: of the Geman-McClure loss.
        xyz: points of the common motion; pivot: its root.
        precision: inverse variances of the offsets, 1/rad^2 and 1/m^2.
        start: offsets of a nearby problem, or None: from zero.

    Returns:
        Rotation and translation in the state's axes, and their inverse covariance.
    """
    frames = _CameraAxes.of(view, scale, xyz, pivot)
    both = _twice(view.R)[:, None]  # rotation and translation, to camera axes
    prior = both @ torch.diag_embed(precision) @ both.mT
    d = torch.zeros_like(precision) if start is None else _to_state(start, view.R.mT)
    for _ in range(INNER_STEPS):
        square = frames.square(d)
        sharpness = square[..., :6, :6] + prior
        gradient = square[..., :6, 6] + (prior * d[..., None, :]).sum(-1)
        step = torch.linalg.solve(sharpness, gradient)
        d = d - step
        if float(_to_state(step, view.R).abs().max()) < CONVERGED:
            break
    return _to_state(d, view.R), both.mT @ sharpness @ both


@dataclass(frozen=True)
class _CameraAxes:
    """One view's keypoints and the common motion's, in camera axes.

    Attributes:
        arms: (B, T, 3, K) from the root, root: (B, T, 3), both metres.
        fx, fy: (B, 1, 1) pixels; x_px, y_px: (B, T, K) from the principal point.
        weight: (B, T, K) 1/px^2, and its root; scale: of the Geman-McClure loss.
    """

    arms: Tensor
    root: Tensor
    fx: Tensor
    fy: Tensor
    x_px: Tensor
    y_px: Tensor
    weight: Tensor
    weight_root: Tensor
    scale: float

    @classmethod
    def of(cls, view: View, scale: float, xyz: Tensor, pivot: Tensor) -> _CameraAxes:
        R, centre = view.R[:, None], view.K[:, None, None, :2, 2]
        x_px, y_px = (view.xy_px - centre).unbind(-1)
        return cls(
            arms=R @ (xyz - pivot[..., None, :]).mT,
            root=(R @ pivot[..., None])[..., 0] + view.shift,
            fx=view.K[:, 0, 0, None, None],
            fy=view.K[:, 1, 1, None, None],
            x_px=x_px.contiguous(),
            y_px=y_px.contiguous(),
            weight=view.weight,
            weight_root=view.weight.sqrt(),
            scale=scale,
        )

    def square(self, d: Tensor) -> Tensor:
        """(B, T, 7, 7) products of the rows [by rotation | by translation | residual] at offsets d.

        An arm a at the end of a derivative J by the point rotates it: ``J (w x a) = (a x J) w``.
        """
        arms = exp(d[..., :3]) @ self.arms
        ax, ay, az = arms.unbind(-2)
        x, y, z = (arms + (self.root + d[..., 3:])[..., None]).unbind(-2)
        nearness = 1 / z.clamp_min(NEAREST_M)
        x, y = x * nearness, y * nearness
        u, v = x * self.fx - self.x_px, y * self.fy - self.y_px
        root = self.weight_root * geman_mcclure_root(self.weight * (u * u + v * v), self.scale)
        near = root * nearness
        ux, vy = near * self.fx, near * self.fy
        uz, vz, zero = -ux * x, -vy * y, torch.zeros_like(x)
        rows = torch.stack(
            [
                ay * uz, ay * vz - az * vy,
                az * ux - ax * uz, -ax * vz,
                -ay * ux, ax * vy,
                ux, zero, zero, vy, uz, vz,
                u * root, v * root,
            ],
            -2,
        ).unflatten(-2, (7, 2)).flatten(-2)  # fmt: skip
        return rows @ rows.mT


def _to_state(d: Tensor, R: Tensor) -> Tensor:
    """Offsets (B, T, 6) from camera axes to the state's."""
    return (d.unflatten(-1, (2, 3)).flatten(1, 2) @ R).view(d.shape)


def _twice(R: Tensor) -> Tensor:
    """(B, 6, 6) with R (B, 3, 3) twice on the diagonal."""
    both = R.new_zeros(len(R), 6, 6)
    both[:, :3, :3] = both[:, 3:, 3:] = R
    return both
