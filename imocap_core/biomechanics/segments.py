"""Anatomical coordinate systems of the body's segments, in the axes of ISB's recommendations.

X points forward, Y up (from the distal to the proximal end of a limb's segment), Z to the right, in
the anatomical position: standing, arms at the sides, palms forward (Wu et al., J. Biomech.
35:543-548, 2002, lower limb; 38:981-992, 2005, upper limb). Left limbs are mirrored at the sagittal
plane, as both papers recommend, so that an angle means the same on both sides.

The body model gives joint centres and no bony landmarks. Long axes run through joint centres; the
axis about which a segment lies around its long axis is that of the rest pose (a T pose, palms down,
toes forward), in which elbows and knees bend about the axes that the model's hinges have.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.conventions import SMPL_JOINTS, SMPL_PARENTS, Side

RIGHT, UP, FORWARD = (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)  # of the rest pose
MIRROR = np.diag([-1.0, 1.0, 1.0])
FOREARM = ("elbow", "wrist")


@dataclass(frozen=True)
class SegmentAxes:
    """How a segment's axes lie in the rest pose of the right side.

    joint: whose rotation turns the segment. proximal, distal: the joint centres on its long axis Y;
    None where Y is vertical. lateral: about where Z points.
    """

    joint: str
    proximal: str | None
    distal: str | None
    lateral: tuple[float, float, float]


TRUNK = {
    "pelvis": SegmentAxes("pelvis", None, None, RIGHT),
    "thorax": SegmentAxes("spine3", None, None, RIGHT),
    "head": SegmentAxes("head", None, None, RIGHT),
}
LIMBS = {
    "thigh": SegmentAxes("hip", "hip", "knee", RIGHT),
    "shank": SegmentAxes("knee", "knee", "ankle", RIGHT),
    "foot": SegmentAxes("ankle", None, None, RIGHT),
    "humerus": SegmentAxes("shoulder", "shoulder", "elbow", UP),
    "forearm": SegmentAxes("elbow", "elbow", "wrist", FORWARD),
    "hand": SegmentAxes("wrist", "wrist", "hand", FORWARD),
}


def anatomical_axes(
    R_local: Float[np.ndarray, "T 24 3 3"], rest_m: Float[np.ndarray, "24 3"], side: Side
) -> Mapping[str, Float[np.ndarray, "T 3 3"]]:
    """Every segment's axes (columns X, Y, Z) in the world, mirrored for the left side.

    Args:
        R_local: rotations of SMPL's joints against their parents, the first in the world.
        rest_m: joint centres in the rest pose.
    """
    flip = MIRROR if side == "left" else np.eye(3)
    R = flip @ global_rotations(R_local) @ flip
    rest = rest_m @ flip
    axes = {}
    for segment, of in {**TRUNK, **LIMBS}.items():
        turned = R[:, joint_index(of.joint, side)]
        if segment == "forearm":
            turned = turned @ _forearm_twist(flip @ R_local @ flip, rest, side)
        axes[segment] = turned @ segment_rest_axes(of, rest, side)
    return axes


def rest_axes(
    rest_m: Float[np.ndarray, "24 3"], side: Side
) -> Mapping[str, Float[np.ndarray, "3 3"]]:
    """Every segment's axes (columns X forward, Y up, Z to the right, on both sides) at rest.

    The left side's are those of the mirrored body, mirrored back, with Z turned to the right again.
    """
    flip = MIRROR if side == "left" else np.eye(3)
    to_right = np.diag([1.0, 1.0, np.linalg.det(flip)])
    parts = {**TRUNK, **LIMBS}.items()
    return {s: flip @ segment_rest_axes(of, rest_m @ flip, side) @ to_right for s, of in parts}


def global_rotations(R_local: Float[np.ndarray, "T 24 3 3"]) -> Float[np.ndarray, "T 24 3 3"]:
    """Rotations of SMPL's joints in the world."""
    R = np.array(R_local)
    for joint, parent in enumerate(SMPL_PARENTS):
        if parent >= 0:
            R[:, joint] = R[:, parent] @ R_local[:, joint]
    return R


def twist_about(
    R: Float[np.ndarray, "T 3 3"], axis: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, "T 3 3"]:
    """Twist of rotations about a unit vector: the rest turns the vector the shortest way.

    Zero where a rotation turns the vector around to its opposite, as no twist is defined there.
    """
    w, v = _quaternion(R)
    return turn_about(axis, 2 * np.arctan2(v @ axis, w))


def twist_gradient(
    R: Float[np.ndarray, "T 3 3"], axis: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, "T 3"]:
    """Derivative of the angle of `twist_about` by increments R <- R exp(delta); NaN where no twist
    is defined."""
    w, v = _quaternion(R)
    along = (v @ axis)[:, None]
    w = w[:, None]
    with np.errstate(invalid="ignore"):
        gradient = (w * (w * axis + np.cross(axis, v)) + along * v) / (along**2 + w**2)
    return np.asarray(gradient)


def _quaternion(
    R: Float[np.ndarray, "T 3 3"],
) -> tuple[Float[np.ndarray, " T"], Float[np.ndarray, "T 3"]]:
    """Unit quaternions (w, v) times 4 |w|."""
    w = 1 + np.trace(R, axis1=1, axis2=2)
    v = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], 1)
    return w, v


def turn_about(
    axis: Float[np.ndarray, " 3"], angle: Float[np.ndarray, " T"]
) -> Float[np.ndarray, "T 3 3"]:
    """Rotations about a unit vector (Rodrigues)."""
    x, y, z = axis
    hat = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sin, cos = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + sin * hat + (1 - cos) * hat @ hat


def _forearm_twist(
    R_local: Float[np.ndarray, "T 24 3 3"], rest: Float[np.ndarray, "24 3"], side: Side
) -> Float[np.ndarray, "T 3 3"]:
    """The part of the wrist's rotation about the forearm's long axis.

    Pronation turns the radius about the ulna, between elbow and wrist; ISB's forearm ends at the
    styloids, which take part in all of it. The model has it in elbow and wrist together.
    """
    return twist_about(R_local[:, joint_index("wrist", side)], forearm_axis(rest, side))


def forearm_axis(rest_m: Float[np.ndarray, "24 3"], side: Side) -> Float[np.ndarray, "3"]:
    """Unit vector from the elbow to the wrist at rest."""
    elbow, wrist = (rest_m[joint_index(joint, side)] for joint in FOREARM)
    return np.asarray((wrist - elbow) / np.linalg.norm(wrist - elbow))


def segment_rest_axes(
    of: SegmentAxes, rest: Float[np.ndarray, "24 3"], side: Side
) -> Float[np.ndarray, "3 3"]:
    """A segment's axes in the rest pose, of a left limb mirrored."""
    y = np.array(UP)
    if of.proximal is not None and of.distal is not None:
        y = rest[joint_index(of.proximal, side)] - rest[joint_index(of.distal, side)]
        y = y / np.linalg.norm(y)
    x = np.cross(y, np.array(of.lateral))
    x = x / np.linalg.norm(x)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def joint_index(joint: str, side: Side) -> int:
    """The column of a joint among SMPL's, of a side where there are two."""
    name = joint if joint in SMPL_JOINTS else f"{side}_{joint}"
    return SMPL_JOINTS.index(name)
