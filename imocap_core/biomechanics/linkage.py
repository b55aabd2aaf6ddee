"""The body as a linkage of rigid segments whose coordinates are ISB's joint angles.

Segments, their axes and the angles between them are those of `segments` and `joint_angles`. With
all coordinates at 0 the body stands in the anatomical position. Lengths are metres, angles radians.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.biomechanics.joint_angles import (
    LEFT_OUT,
    MIDDLE,
    PAIRED,
    YXY,
    YXZ,
    ZXY,
    JointDefinition,
)
from imocap_core.biomechanics.segments import rest_axes
from imocap_core.conventions import SIDES, SMPL_JOINTS, Side

X, Y, Z = np.eye(3)
AXES = {ZXY: (Z, X, Y), YXZ: (Y, X, Z), YXY: (Y, -X, Y)}  # as `cardan` takes rotations apart
SEGMENT_OF_CENTRE = {
    "pelvis": ("pelvis", "hip", "spine1"),
    "thorax": ("spine3", "neck", "collar"),
    "head": ("head",),
    "thigh": ("knee",),
    "shank": ("ankle",),
    "foot": ("foot",),
    "humerus": ("shoulder", "elbow"),
    "forearm": ("wrist",),
    "hand": ("hand",),
}
# Where a segment begins: the mean of these joint centres. The spine bends at several joints and the
# neck at two; one joint each stands for them, in the middle, and translations for the rest.
ORIGINS = {
    "pelvis": ("pelvis",),
    "thorax": ("spine2",),
    "head": ("neck", "head"),
    "thigh": ("hip",),
    "shank": ("knee",),
    "foot": ("ankle",),
    "humerus": ("shoulder",),
    "forearm": ("elbow",),
    "hand": ("wrist",),
}
# Joints with translations: the root, spine and neck (above), and the shoulder girdle.
MOVING = ("pelvis", "trunk", "neck", "shoulder")
SIDED = tuple(of.distal for of in PAIRED.values())


@dataclass(frozen=True, eq=False)
class Coordinate:
    """A joint's angle, turning the child about an axis, positive as the angle's name says."""

    name: str
    axis: Float[np.ndarray, "3"]


@dataclass(frozen=True, eq=False)
class Link:
    """A segment and the joint that it hangs on.

    Attributes:
        segment, parent: names; the parent of the pelvis is None, the ground.
        place_m: the segment's origin in the parent's axes, all coordinates 0.
        rotations: in their order, each about an axis that the ones before have turned.
        translations: coordinates along the parent's X, Y and Z; or none.
        origin_m, axes: of the segment in the rest pose, columns X, Y, Z.
    """

    segment: str
    joint: str
    parent: str | None
    place_m: Float[np.ndarray, "3"]
    rotations: tuple[Coordinate, ...]
    translations: tuple[str, ...]
    origin_m: Float[np.ndarray, "3"]
    axes: Float[np.ndarray, "3 3"]

    def local_m(self, points_m: Float[np.ndarray, "*N 3"]) -> Float[np.ndarray, "*N 3"]:
        """Points of the rest pose that belong to the segment, in its axes."""
        return np.asarray((points_m - self.origin_m) @ self.axes)


def linkage(rest_m: Float[np.ndarray, "24 3"]) -> dict[str, Link]:
    """The segments of a body by name, parents before children; `left_` and `right_` of limbs.

    rest_m: SMPL's joints in the rest pose.
    """
    links: dict[str, Link] = {}
    for joint, of in MIDDLE.items():
        _add(links, "", joint, of, rest_m, "right")
    for side in SIDES:
        for joint, of in PAIRED.items():
            _add(links, f"{side}_", joint, of, rest_m, side)
    return links


def segment_of_joint(joint: str) -> str | None:
    """The segment with which a joint centre of SMPL moves; None where it moves with none."""
    side, _, name = joint.partition("_")
    sided = side in SIDES
    for segment, centres in SEGMENT_OF_CENTRE.items():
        if (name if sided else joint) in centres:
            return f"{side}_{segment}" if sided and segment in SIDED else segment
    return None


def _add(
    links: dict[str, Link],
    prefix: str,
    joint: str,
    of: JointDefinition,
    rest_m: Float[np.ndarray, "24 3"],
    side: Side,
) -> None:
    parent = None if of.proximal is None else links[_name(of.proximal, prefix)]
    origin = np.mean([rest_m[_index(c, prefix)] for c in ORIGINS[of.distal]], axis=0)
    links[prefix + of.distal] = Link(
        segment=prefix + of.distal,
        joint=prefix + joint,
        parent=None if parent is None else parent.segment,
        place_m=np.zeros(3) if parent is None else parent.local_m(origin),
        rotations=_rotations(prefix, joint, of),
        translations=tuple(f"{prefix}{joint}_t{a}" for a in "xyz") if joint in MOVING else (),
        origin_m=origin,
        axes=rest_axes(rest_m, side)[of.distal],
    )


def _rotations(prefix: str, joint: str, of: JointDefinition) -> tuple[Coordinate, ...]:
    """Mirrored limbs turn about -X and -Y where those of the right side turn about X and Y."""
    mirror = np.array([-1.0, -1.0, 1.0]) if prefix == "left_" else np.ones(3)
    return tuple(
        Coordinate(f"{prefix}{joint}_{name}", sign * mirror * axis)
        for (name, sign), axis in zip(of.angles, AXES[of.order], strict=True)
        if f"{joint}_{name}" not in LEFT_OUT
    )


def _name(segment: str, prefix: str) -> str:
    return prefix + segment if segment in SIDED else segment


def _index(joint: str, prefix: str) -> int:
    return SMPL_JOINTS.index(joint if joint in SMPL_JOINTS else prefix + joint)
