"""From angles to the 21 keypoints of a hand, with analytic derivatives.

With right local increments everything beyond joint k turns about it: d p = (G_k d) x (p - p_k),
G_k the joint's rotation; and the increment of a rotation vector a is ``Jr(a) da``.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.hands.skeleton import OPENPOSE_FINGERS
from imocap_core.rotations import exp, right_jacobian


def joint_vectors(
    axes: Float[Tensor, "... 5 3 3 21"], angles: Float[Tensor, "... 21"]
) -> Float[Tensor, "... 5 3 3"]:
    """Rotation vectors of the joints, radians; arguments broadcast."""
    return torch.einsum("...fjcd,...d->...fjc", axes, angles)


def hand_points(
    bones: Float[Tensor, "... 5 4 3"],
    axes: Float[Tensor, "... 5 3 3 21"],
    R_wrist: Float[Tensor, "... 3 3"],
    angles: Float[Tensor, "... 21"],
) -> tuple[Float[Tensor, "... 21 3"], Float[Tensor, "... 21 3 3"], Float[Tensor, "... 21 3 21"]]:
    """Keypoints in OpenPose's order, and their derivatives.

    Args:
        bones: (..., 5, 4, 3) metres; axes: (..., 5, 3, 3, 21); see `HandSkeleton`.
        R_wrist: (..., 3, 3) of the hand; angles: (..., 21) radians. All broadcast.

    Returns:
        xyz (..., 21, 3) from the wrist, metres; d_wrist (..., 21, 3, 3) by right increments of
        R_wrist; d_angles (..., 21, 3, 21).
    """
    vectors = joint_vectors(axes, angles)
    local = exp(vectors)
    R = R_wrist[..., None, :, :]
    turned = [R]  # rotation before each bone
    place = (R @ bones[..., 0, :, None])[..., 0]
    points = [place]
    for joint in range(3):
        turned.append(turned[-1] @ local[..., joint, :, :])
        place = place + (turned[-1] @ bones[..., joint + 1, :, None])[..., 0]
        points.append(place)
    xyz = torch.stack(points, dim=-2)  # (..., 5, 4, 3)
    levers = torch.stack(turned[1:], dim=-3) @ right_jacobian(vectors) @ axes  # (..., 5, 3, 3, 21)
    d_angles = [torch.zeros_like(levers[..., 0, :, :])]
    for end in range(1, 4):
        arms = xyz[..., end, None, :] - xyz[..., :end, :]
        moved = torch.linalg.cross(
            levers[..., :end, :, :], arms[..., None].expand_as(levers[..., :end, :, :]), dim=-2
        )
        d_angles.append(moved.sum(-3))
    d_points = torch.stack(d_angles, dim=-3)  # (..., 5, 4, 3, 21)
    d_wrist = torch.linalg.cross(
        R_wrist[..., None, None, :, :].expand(*xyz.shape, 3),
        xyz[..., None].expand(*xyz.shape, 3),
        dim=-2,
    )
    return _in_order(xyz, 2), _in_order(d_wrist, 3), _in_order(d_points, 3)


def _in_order(values: Tensor, trailing: int) -> Tensor:
    """(..., 5, 4, *rest) to (..., 21, *rest) with the wrist, which stays at 0, first."""
    axis = values.ndim - trailing - 1
    ordered = values.index_select(axis, torch.tensor(OPENPOSE_FINGERS, device=values.device))
    flat = ordered.flatten(axis, axis + 1)
    return torch.cat([torch.zeros_like(flat.narrow(axis, 0, 1)), flat], dim=axis)
