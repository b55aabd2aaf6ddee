"""The body as a linkage of rigid segments whose coordinates are ISB's joint angles.

Segments, their axes and the angles between them are those of `segments` and `joint_angles`. With
all coordinates at 0 the body stands in the anatomical position. Lengths are metres, angles radians.

Mass and inertia of the linkage's segments, for a body of known shape. The total comes from the
volume of the surface; the shares are de Leva's (`body.mass`), the inertia is that of a homogeneous
ellipsoid as large as the segment's vertices reach. Good for pictures and first estimates; a study
of forces wants measured numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from imocap_core.biomechanics.joint_angles import (
    DECOMPOSITIONS,
    LEFT_OUT,
    MIDDLE,
    PAIRED,
    WORLD,
    YXY,
    YXZ,
    ZXY,
    JointDefinition,
    joint_angles_rad,
    yxy_everywhere,
)
from imocap_core.biomechanics.segments import global_rotations, joint_index, rest_axes
from imocap_core.body.kinematics import LIMB_SEGMENTS, MIDDLE_SEGMENTS
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
    origin = np.mean([rest_m[joint_index(c, side)] for c in ORIGINS[of.distal]], axis=0)
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


DEFINED_EVERYWHERE = DECOMPOSITIONS | {YXY: yxy_everywhere}
CARRIER = {  # of segments with translations, or with such on them: the joint that carries them
    "pelvis": "pelvis",
    "thorax": "spine3",
    "head": "head",
    "left_humerus": "left_shoulder",
    "right_humerus": "right_shoulder",
}
Series = dict[str, Float[np.ndarray, " T"]]


def to_ground(points_m: Float[np.ndarray, "*N 3"]) -> Float[np.ndarray, "*N 3"]:
    """Points of a world with y up in the ground's axes: X ahead (z), Y up, Z to the right (-x)."""
    return np.asarray(points_m @ WORLD)


def linkage_coordinates(
    links: Mapping[str, Link],
    R_local: Float[np.ndarray, "T 24 3 3"],
    joints_m: Float[np.ndarray, "T 24 3"],
    rest_m: Float[np.ndarray, "24 3"],
) -> Series:
    """Every coordinate of `linkage` over time, radians and metres, without jumps of a turn.

    Args:
        R_local, joints_m: of SMPL's joints; the first rotation and the places in a world with y up.
        rest_m: the joints of the rest pose.
    """
    values: Series = joint_angles_rad(R_local, rest_m, DEFINED_EVERYWHERE)
    frames = _frames(links, global_rotations(R_local), joints_m, rest_m)
    for link in links.values():
        if link.translations:
            values |= _translations(link, frames)
    return values


Frame = tuple[Float[np.ndarray, "T 3 3"], Float[np.ndarray, "T 3"]]


def _frames(
    links: Mapping[str, Link],
    R: Float[np.ndarray, "T 24 3 3"],
    joints_m: Float[np.ndarray, "T 24 3"],
    rest_m: Float[np.ndarray, "24 3"],
) -> dict[str | None, Frame]:
    """Axes and origins, in the world, of the segments of the middle and of both humeri."""
    count = len(joints_m)
    frames: dict[str | None, Frame] = {None: (np.tile(WORLD, (count, 1, 1)), np.zeros((count, 3)))}
    for segment, joint in CARRIER.items():
        link, j = links[segment], SMPL_JOINTS.index(joint)
        origin = joints_m[:, j] + R[:, j] @ (link.origin_m - rest_m[j])
        frames[segment] = R[:, j] @ link.axes, origin
    return frames


def _translations(link: Link, frames: Mapping[str | None, Frame]) -> Series:
    """How far a segment's origin is from its place on the parent, in the parent's axes."""
    axes, origin = frames[link.parent]
    away = frames[link.segment][1] - origin
    moved = np.einsum("tji,tj->ti", axes, away) - link.place_m
    return dict(zip(link.translations, moved.T, strict=True))


DENSITY_KG_M3 = 1000.0  # of a whole body, about that of water
JOINTS_OF = {  # whose vertices make up a segment
    "pelvis": ("pelvis", "spine1"),
    "thorax": ("spine2", "spine3", "collar"),
    "head": ("neck", "head"),
    "thigh": ("hip",),
    "shank": ("knee",),
    "foot": ("ankle", "foot"),
    "humerus": ("shoulder",),
    "forearm": ("elbow",),
    "hand": ("wrist", "hand"),
}


@dataclass(frozen=True, eq=False)
class SegmentMass:
    """mass_kg; centre_m and radii_m of the ellipsoid in the segment's axes; inertia_kg_m2 about
    these through the centre."""

    mass_kg: float
    centre_m: Float[np.ndarray, "3"]
    radii_m: Float[np.ndarray, "3"]

    @property
    def inertia_kg_m2(self) -> Float[np.ndarray, "3"]:
        """Principal moments of a solid ellipsoid."""
        squares = self.radii_m**2
        return np.asarray(self.mass_kg / 5 * (squares.sum() - squares))


def segment_masses(
    links: Mapping[str, Link],
    vertices_m: Float[np.ndarray, "V 3"],
    faces: Int[np.ndarray, "F 3"],
    owners: list[str],
) -> dict[str, SegmentMass]:
    """Mass and shape of every segment.

    Args:
        vertices_m: of the rest pose. owners: per vertex the joint that moves it most.
    """
    total = DENSITY_KG_M3 * _volume_m3(vertices_m, faces)
    shares = _shares()
    masses = {}
    for name, link in links.items():
        prefix, segment = _parted(name)
        joints = {j for base in JOINTS_OF[segment] for j in (base, prefix + base)}
        if not prefix:
            joints |= {f"{side}_{base}" for side in SIDES for base in JOINTS_OF[segment]}
        points = link.local_m(vertices_m[np.isin(owners, sorted(joints))])
        low, high = points.min(axis=0), points.max(axis=0)
        masses[name] = SegmentMass(total * shares[segment], (low + high) / 2, (high - low) / 2)
    return masses


def _volume_m3(vertices_m: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]) -> float:
    """Volume inside a closed surface: the sum of the signed tetrahedra from its triangles."""
    a, b, c = (vertices_m[faces[:, k]] for k in range(3))
    return float((a * np.cross(b, c)).sum() / 6)


def _shares() -> dict[str, float]:
    """Each segment's share of the body's mass; the trunk's lower third is the pelvis'."""
    by_start = {start: share for start, _, share, _ in (*MIDDLE_SEGMENTS, *LIMB_SEGMENTS)}
    shares = {segment: by_start[ORIGINS[segment][0]] for segment in SIDED}
    thorax = by_start["spine1"] + by_start["spine3"]
    return shares | {"head": by_start["neck"], "thorax": thorax, "pelvis": by_start["pelvis"]}


def _parted(name: str) -> tuple[str, str]:
    """A link's side, as a prefix, and its segment."""
    side, _, segment = name.partition("_")
    return (f"{side}_", segment) if side in SIDES else ("", name)
