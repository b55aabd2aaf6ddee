"""Rotations in three dimensions (SO(3)), in torch: batched over leading axes, differentiable.

Computations use 3x3 matrices. Axis-angle vectors (radians), unit quaternions (w, x, y, z) and the
6D form are for input and output. A *right local increment* of R is a vector delta with
``R <- R @ exp(delta)``; solvers step with these.
"""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor

_SMALL_RAD2 = 1e-4  # below this squared angle, series are exact to round-off and never divide by 0


def hat(vector: Float[Tensor, "... 3"]) -> Float[Tensor, "... 3 3"]:
    """Cross-product matrix: ``hat(a) @ b == cross(a, b)``."""
    x, y, z = vector.unbind(-1)
    zero = torch.zeros_like(x)
    rows = torch.stack((zero, -z, y, z, zero, -x, -y, x, zero), dim=-1)
    return rows.unflatten(-1, (3, 3))


def exp(axis_angle: Float[Tensor, "... 3"]) -> Float[Tensor, "... 3 3"]:
    """Exponential map: axis-angle vectors, radians, to rotation matrices (Rodrigues' formula).

    Values and first derivatives are exact at zero too (series below 0.01 rad).
    """
    angle2 = (axis_angle * axis_angle).sum(-1)[..., None, None]
    small = angle2 < _SMALL_RAD2
    safe2 = torch.where(small, torch.ones_like(angle2), angle2)
    angle = safe2.sqrt()
    sine = torch.where(small, 1 - angle2 / 6 + angle2**2 / 120, torch.sin(angle) / angle)
    cosine = torch.where(
        small,
        0.5 - angle2 / 24 + angle2**2 / 720,
        2 * torch.sin(angle / 2) ** 2 / safe2,  # (1 - cos) / angle^2 without cancellation
    )
    outer = axis_angle[..., :, None] * axis_angle[..., None, :]
    identity = torch.eye(3, dtype=axis_angle.dtype, device=axis_angle.device)
    return identity + sine * hat(axis_angle) + cosine * (outer - angle2 * identity)


def log(rotation: Float[Tensor, "... 3 3"]) -> Float[Tensor, "... 3"]:
    """Logarithm map: rotation matrices to axis-angle vectors, radians, of angle at most pi.

    Computed by the quaternion, so it is accurate near 0 and near pi alike. At exactly pi the
    axis' sign is arbitrary: use `nearest_branch` to follow a path.
    """
    return quaternion_to_axis_angle(matrix_to_quaternion(rotation))


def matrix_to_quaternion(rotation: Float[Tensor, "... 3 3"]) -> Float[Tensor, "... 4"]:
    """Rotation matrices to unit quaternions w, x, y, z with w >= 0.

    Shepperd's method (1978): of the four formulas for the quaternion, the one that divides by the
    largest component.
    """
    m00, m01, m02, m10, m11, m12, m20, m21, m22 = rotation.flatten(-2).unbind(-1)
    rows = torch.stack(
        (
            torch.stack((1 + m00 + m11 + m22, m21 - m12, m02 - m20, m10 - m01), -1),
            torch.stack((m21 - m12, 1 + m00 - m11 - m22, m01 + m10, m02 + m20), -1),
            torch.stack((m02 - m20, m01 + m10, 1 - m00 + m11 - m22, m12 + m21), -1),
            torch.stack((m10 - m01, m02 + m20, m12 + m21, 1 - m00 - m11 + m22), -1),
        ),
        dim=-2,
    )
    best = rows.diagonal(dim1=-2, dim2=-1).argmax(-1)
    index = best[..., None, None].expand(*best.shape, 1, 4)
    quaternion = rows.gather(-2, index).squeeze(-2)
    quaternion = quaternion / quaternion.norm(dim=-1, keepdim=True)
    return torch.where(quaternion[..., :1] < 0, -quaternion, quaternion)


def quaternion_to_axis_angle(quaternion: Float[Tensor, "... 4"]) -> Float[Tensor, "... 3"]:
    """Unit quaternions w, x, y, z to axis-angle vectors, radians, at most pi long."""
    quaternion = torch.where(quaternion[..., :1] < 0, -quaternion, quaternion)
    w, vector = quaternion[..., :1], quaternion[..., 1:]
    sine2 = (vector * vector).sum(-1, keepdim=True)
    small = sine2 < _SMALL_RAD2**2
    sine = torch.where(small, torch.ones_like(sine2), sine2).sqrt()
    scale = torch.where(small, (2 - 2 * sine2 / (3 * w * w)) / w, 2 * torch.atan2(sine, w) / sine)
    return scale * vector


def geodesic_angle(
    a: Float[Tensor, "... 3 3"], b: Float[Tensor, "... 3 3"]
) -> Float[Tensor, "..."]:
    """Geodesic distance: the angle of the rotation from a to b, radians, 0 to pi.

    By sine and cosine together: accurate at both ends, where ``arccos`` loses half the digits.
    """
    relative = a.transpose(-1, -2) @ b
    skew = relative - relative.transpose(-1, -2)
    twice_sine = (skew * skew).sum((-2, -1)).div(2).sqrt()
    twice_cosine = relative.diagonal(dim1=-2, dim2=-1).sum(-1) - 1
    return torch.atan2(twice_sine, twice_cosine)


def nearest_branch(
    axis_angle: Float[Tensor, "... 3"], reference: Float[Tensor, "... 3"]
) -> Float[Tensor, "... 3"]:
    """The axis-angle vector of the same rotation that is nearest to `reference`.

    A rotation has the vectors ``(angle + 2 pi k) axis`` for every integer k. For the identity the
    reference's axis is used.
    """
    angle = axis_angle.norm(dim=-1, keepdim=True)
    tiny = angle < 1e-12
    reference_angle = reference.norm(dim=-1, keepdim=True)
    fallback = reference / reference_angle.clamp_min(1e-12)
    axis = torch.where(tiny, fallback, axis_angle / angle.clamp_min(1e-12))
    along = (axis * reference).sum(-1, keepdim=True)
    turns = torch.round((along - angle) / (2 * math.pi))
    return torch.where(turns == 0, axis_angle, (angle + 2 * math.pi * turns) * axis)


def unwrap(axis_angle: Float[Tensor, "T *batch 3"]) -> Float[Tensor, "T *batch 3"]:
    """A path of axis-angle vectors, each on the branch nearest to the one before."""
    path = [axis_angle[0]]
    for vector in axis_angle[1:]:
        path.append(nearest_branch(vector, path[-1]))
    return torch.stack(path)


def project(matrix: Float[Tensor, "... 3 3"]) -> Float[Tensor, "... 3 3"]:
    """Nearest rotations to any matrices, in the Frobenius norm, by SVD (Kabsch 1976)."""
    u, _, vt = torch.linalg.svd(matrix)
    sign = torch.linalg.det(u @ vt)
    flip = torch.stack((torch.ones_like(sign), torch.ones_like(sign), sign), dim=-1)
    return (u * flip[..., None, :]) @ vt


def mean(
    rotation: Float[Tensor, "... 3 3"], weights: Float[Tensor, "..."] | None = None, dim: int = 0
) -> Float[Tensor, "... 3 3"]:
    """Weighted chordal mean over a leading axis: argmin over R of sum w |R - R_i|_F^2.

    Parameters
    ----------
    dim: the leading axis of `rotation` (0 is the first; -1 the last one).
    weights: non-negative, broadcast against the leading axes; None means equal. Where all
        weights are zero the result is the identity, never NaN.
    """
    leading = rotation.shape[:-2]
    axis = dim % len(leading)
    if weights is None:
        weights = torch.ones((), dtype=rotation.dtype, device=rotation.device)
    weights = weights.to(rotation).expand(leading)
    total = (weights[..., None, None] * rotation).sum(axis)
    empty = (weights.sum(axis) <= 0)[..., None, None]
    identity = torch.eye(3, dtype=rotation.dtype, device=rotation.device)
    return project(torch.where(empty, identity, total))


def right_jacobian(axis_angle: Float[Tensor, "... 3"]) -> Float[Tensor, "... 3 3"]:
    """Right Jacobian of SO(3): Jr with ``exp(a + d) ~ exp(a) @ exp(Jr d)``.

    Converts derivatives by right local increments to derivatives by axis-angle:
    ``d x / d a = (d x / d delta) @ Jr``.
    """
    angle2 = (axis_angle * axis_angle).sum(-1)[..., None, None]
    small = angle2 < _SMALL_RAD2
    safe2 = torch.where(small, torch.ones_like(angle2), angle2)
    angle = safe2.sqrt()
    first = torch.where(small, 0.5 - angle2 / 24, 2 * torch.sin(angle / 2) ** 2 / safe2)
    second = torch.where(small, 1 / 6 - angle2 / 120, (angle - torch.sin(angle)) / (safe2 * angle))
    cross = hat(axis_angle)
    identity = torch.eye(3, dtype=axis_angle.dtype, device=axis_angle.device)
    return identity - first * cross + second * (cross @ cross)


def inverse_right_jacobian(axis_angle: Float[Tensor, "... 3"]) -> Float[Tensor, "... 3 3"]:
    """Inverse right Jacobian of SO(3), for angles below 2 pi.

    Converts derivatives by axis-angle to derivatives by right local increments.
    """
    angle2 = (axis_angle * axis_angle).sum(-1)[..., None, None]
    small = angle2 < _SMALL_RAD2
    safe2 = torch.where(small, torch.ones_like(angle2), angle2)
    half = safe2.sqrt() / 2
    second = torch.where(small, 1 / 12 + angle2 / 720, (1 - half / torch.tan(half)) / safe2)
    cross = hat(axis_angle)
    identity = torch.eye(3, dtype=axis_angle.dtype, device=axis_angle.device)
    return identity + cross / 2 + second * (cross @ cross)
