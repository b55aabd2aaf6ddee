"""The bones, joint axes and ranges of motion of two hands, and the positions of 21 keypoints.

Bones are those of the given body (the free body's fingers are MakeHuman's, CC0). A hand has 21
angles: each finger bends at three joints and spreads at its knuckle; the thumb's root turns about
three axes. Angles are 0 in the body's rest pose, in which fingers are straight but for about 20
degrees a joint; positive ones close the hand. Ranges are about those of clinical goniometry,
relative to that pose.

From angles to the 21 keypoints of a hand, with analytic derivatives. With right local increments
everything beyond joint k turns about it: d p = (G_k d) x (p - p_k), G_k the joint's rotation; and
the increment of a rotation vector a is ``Jr(a) da``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.body.model import Shaped
from imocap_core.conventions import SIDES
from imocap_core.rotations import exp, right_jacobian

FINGERS = ("index", "middle", "pinky", "ring", "thumb")  # SMPL+H's order
ANGLES = 21
POINTS = 21
OPENPOSE_FINGERS = (4, 0, 1, 3, 2)  # OpenPose goes from the thumb to the little finger

_FINGER = ("bend1", "spread", "bend2", "bend3")
_THUMB = ("root_bend", "root_spread", "root_twist", "bend2", "bend3")
ANGLE_NAMES: tuple[str, ...] = (
    *(f"{finger}_{angle}" for finger in FINGERS[:4] for angle in _FINGER),
    *(f"thumb_{angle}" for angle in _THUMB),
)
# degrees from the rest pose: least, most, and the spread of everyday poses
_RANGE_DEG = {"bend1": (-35, 75, 35), "spread": (-20, 20, 8), "bend2": (-25, 95, 40)}
_RANGE_DEG |= {"bend3": (-20, 70, 30)}
_THUMB_RANGE_DEG = {"root_bend": (-35, 40, 18), "root_spread": (-35, 35, 18)}
_THUMB_RANGE_DEG |= {"root_twist": (-30, 30, 12), "bend2": (-15, 60, 22), "bend3": (-25, 75, 30)}


@dataclass(frozen=True)
class HandSkeleton:
    """A left and a right hand of one person (first axis of every tensor: left, right).

    Attributes:
        bones: (2, 5, 4, 3) metres, per finger from the wrist to its root and on to the tip.
        axes: (2, 5, 3, 3, 21) rotation vector of each joint per unit of each angle.
        lower, upper, spread: (21,) radians.
    """

    bones: Float[Tensor, "2 5 4 3"]
    axes: Float[Tensor, "2 5 3 3 21"]
    lower: Float[Tensor, "21"]
    upper: Float[Tensor, "21"]
    spread: Float[Tensor, "21"]

    @property
    def length_m(self) -> Float[Tensor, "2"]:
        """From the wrist to the tip of the middle finger, along its bones."""
        return self.bones[:, 1].norm(dim=-1).sum(-1)


def hand_skeleton(shaped: Shaped) -> HandSkeleton:
    """The hands of a body with SMPL+H's fingers, of one shape (coefficients (n,)).

    Raises:
        ValueError: the body has no fingers.
    """
    names, rest = shaped.model.joint_names, shaped.joints_rest
    if "left_index1" not in names:
        raise ValueError(f"body: expected one with fingers, got {shaped.model.name}")
    still = torch.eye(3, dtype=rest.dtype, device=rest.device).expand(len(names), 3, 3)
    posed = shaped.pose(still, rest.new_zeros(3))
    bones, axes = [], []
    for side in SIDES:
        points = shaped.model.points(f"{side}_hand21")
        place = dict(zip(points.names, posed.keypoints(points), strict=True))
        wrist = place[f"{side}_hand_root"]
        fingers = torch.stack(
            [torch.stack([place[f"{side}_{f}{end}"] for end in (1, 2, 3, "_tip")]) for f in FINGERS]
        )
        start = torch.cat([wrist.expand(5, 1, 3), fingers[:, :-1]], dim=1)
        bones.append(fingers - start)
        axes.append(_axes(fingers - wrist, 1.0 if side == "left" else -1.0))
    ranges = np.deg2rad([_range(name) for name in ANGLE_NAMES])
    lower, upper, spread = torch.as_tensor(ranges).to(rest).unbind(-1)
    return HandSkeleton(torch.stack(bones), torch.stack(axes), lower, upper, spread)


def _range(name: str) -> tuple[int, int, int]:
    finger, angle = name.split("_", 1)
    return _THUMB_RANGE_DEG[angle] if finger == "thumb" else _RANGE_DEG[angle]


def _axes(fingers: Tensor, sign: float) -> Tensor:
    """(5, 3, 3, 21) of one hand; fingers (5, 4, 3) at rest from the wrist."""
    back = sign * torch.linalg.cross(fingers[0, 0], fingers[2, 0])  # out of the hand's back
    bones = torch.nn.functional.normalize(fingers[:, 1:] - fingers[:, :-1], dim=-1)
    axes = fingers.new_zeros(5, 3, 3, ANGLES)
    for f in range(4):
        for joint, angle in enumerate((0, 2, 3)):
            axes[f, joint, :, 4 * f + angle] = _unit(torch.linalg.cross(back, bones[f, joint]))
        axes[f, 0, :, 4 * f + 1] = _unit(back)
    # the thumb bends across the palm, towards the root of the little finger and in front of it
    before = fingers[2, 0] - 0.5 * _unit(back) * (fingers[0, 0] - fingers[2, 0]).norm()
    for joint, angle in enumerate((16, 19, 20)):
        across = before - fingers[4, joint]
        axes[4, joint, :, angle] = _unit(torch.linalg.cross(bones[4, joint], across))
    axes[4, 0, :, 17] = _unit(torch.linalg.cross(axes[4, 0, :, 16], bones[4, 0]))
    axes[4, 0, :, 18] = bones[4, 0]
    return axes


def _unit(vector: Tensor) -> Tensor:
    return vector / vector.norm()


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
