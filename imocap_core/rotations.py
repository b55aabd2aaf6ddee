"""Rotations in three dimensions (SO(3)), in torch: batched over leading axes, differentiable.

Computations use 3x3 matrices. Axis-angle vectors (radians), unit quaternions (w, x, y, z) and the
6D form are for input and output. A *right local increment* of R is a vector delta with
``R <- R @ exp(delta)``; solvers step with these.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.workers import compiled

_SMALL_RAD2 = 1e-4  # below this squared angle, series are exact to round-off and never divide by 0


def for_processor(values: Tensor) -> bool:
    """Whether compiled loops take them: double, on a processor, no derivatives are asked for."""
    traced = values.requires_grad or torch._C._functorch.is_functorch_wrapped_tensor(values)
    return not (values.is_cuda or traced) and values.dtype == torch.float64


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
    if for_processor(axis_angle):
        return _of_vectors(_exponentials, axis_angle)
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


def _of_vectors(loop: Callable[..., None], vectors: Tensor) -> Tensor:
    """Matrices (..., 3, 3) of vectors (..., 3) by a compiled loop."""
    rows = vectors.reshape(-1, 3).contiguous()
    matrices = rows.new_empty(len(rows), 3, 3)
    loop(rows.numpy(), matrices.numpy())
    return matrices.view(*vectors.shape, 3)


@compiled
def _exponentials(vectors, R):  # type: ignore[no-untyped-def]
    """`exp` in place."""
    for i in range(len(vectors)):
        fill_rotation(vectors[i, 0], vectors[i, 1], vectors[i, 2], R[i])


@compiled
def fill_rotation(x, y, z, R):  # type: ignore[no-untyped-def]
    """In compiled loops: the rotation R of a vector, in place."""
    square = x * x + y * y + z * z
    if square < _SMALL_RAD2:
        sine = 1 - square / 6 + square**2 / 120
        cosine = 0.5 - square / 24 + square**2 / 720
    else:
        angle = np.sqrt(square)
        sine, cosine = np.sin(angle) / angle, 2 * np.sin(angle / 2) ** 2 / square
    _fill(x, y, z, sine, cosine, R)


@compiled
def _inverse_jacobians(vectors, J):  # type: ignore[no-untyped-def]
    """`inverse_right_jacobian` in place."""
    for i in range(len(vectors)):
        x, y, z = vectors[i]
        square = x * x + y * y + z * z
        if square < _SMALL_RAD2:
            second = 1 / 12 + square / 720
        else:
            half = np.sqrt(square) / 2
            second = (1 - half / np.tan(half)) / square
        _fill(x, y, z, 0.5, second, J[i])


@compiled
def _fill(x, y, z, a, b, M):  # type: ignore[no-untyped-def]
    """``1 + a C + b C C`` with the vector's cross-product matrix C."""
    M[0] = 1 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y
    M[1] = b * x * y + a * z, 1 - b * (x * x + z * z), b * y * z - a * x
    M[2] = b * x * z - a * y, b * y * z + a * x, 1 - b * (x * x + y * y)


def log(rotation: Float[Tensor, "... 3 3"]) -> Float[Tensor, "... 3"]:
    """Logarithm map: rotation matrices to axis-angle vectors, radians, of angle at most pi.

    Computed by the quaternion, so it is accurate near 0 and near pi alike. At exactly pi the
    axis' sign is arbitrary: use `nearest_branch` to follow a path.
    """
    if for_processor(rotation):
        vectors = rotation.new_empty(rotation.shape[:-1])
        _logarithms(rotation.reshape(-1, 9).contiguous().numpy(), vectors.view(-1, 3).numpy())
        return vectors
    w, vector = matrix_to_quaternion(rotation).split([1, 3], -1)
    sine2 = (vector * vector).sum(-1, keepdim=True)
    small = sine2 < _SMALL_RAD2**2
    sine = torch.where(small, torch.ones_like(sine2), sine2).sqrt()
    scale = torch.where(small, (2 - 2 * sine2 / (3 * w * w)) / w, 2 * torch.atan2(sine, w) / sine)
    return scale * vector


@compiled
def _logarithms(R, vectors):  # type: ignore[no-untyped-def]
    """By quaternions: of four formulas the one that divides by the largest component."""
    q = np.empty(4)
    for i in range(len(R)):
        a, b, c, d, e, f, g, h, k = R[i]
        squares = 1 + a + e + k, 1 + a - e - k, 1 - a + e - k, 1 - a - e + k
        if squares[0] >= max(squares[1:]):
            q[:] = squares[0], h - f, c - g, d - b
        elif squares[1] >= max(squares[2:]):
            q[:] = h - f, squares[1], b + d, c + g
        elif squares[2] >= squares[3]:
            q[:] = c - g, b + d, squares[2], f + h
        else:
            q[:] = d - b, c + g, f + h, squares[3]
        sine2 = q[1] ** 2 + q[2] ** 2 + q[3] ** 2
        norm = np.sqrt(q[0] ** 2 + sine2)
        if q[0] < 0:
            norm = -norm
        w, sine2 = q[0] / norm, sine2 / norm**2
        if sine2 < _SMALL_RAD2**2:
            scale = (2 - 2 * sine2 / (3 * w * w)) / w
        else:
            scale = 2 * np.arctan2(np.sqrt(sine2), w) / np.sqrt(sine2)
        vectors[i] = scale / norm * q[1:]


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
    if for_processor(axis_angle):
        return _of_vectors(_inverse_jacobians, axis_angle)
    angle2 = (axis_angle * axis_angle).sum(-1)[..., None, None]
    small = angle2 < _SMALL_RAD2
    safe2 = torch.where(small, torch.ones_like(angle2), angle2)
    half = safe2.sqrt() / 2
    second = torch.where(small, 1 / 12 + angle2 / 720, (1 - half / torch.tan(half)) / safe2)
    cross = hat(axis_angle)
    identity = torch.eye(3, dtype=axis_angle.dtype, device=axis_angle.device)
    return identity + cross / 2 + second * (cross @ cross)
