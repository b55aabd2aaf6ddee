"""Anatomical coordinate systems of the body's segments (ISB), and surface markers on them.

X points forward, Y up (from the distal to the proximal end of a limb's segment), Z to the right, in
the anatomical position: standing, arms at the sides, palms forward (Wu et al., J. Biomech.
35:543-548, 2002, lower limb; 38:981-992, 2005, upper limb). Left limbs are mirrored at the sagittal
plane, as both papers recommend, so that an angle means the same on both sides.

The body model gives joint centres and no bony landmarks. Long axes run through joint centres; the
axis about which a segment lies around its long axis is that of the rest pose (a T pose, palms down,
toes forward), in which elbows and knees bend about the axes that the model's hinges have.

Surface markers, for programs that want markers: where a ray from a point on a segment's long axis
leaves the body at rest, without vertices that skinning shares between segments. None is a palpated
landmark, and names say so (`thigh_front`, not a bone).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.conventions import SIDES, SMPL_JOINTS, SMPL_PARENTS, Side

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


SEGMENTS = {
    "pelvis": SegmentAxes("pelvis", None, None, RIGHT),
    "thorax": SegmentAxes("spine3", None, None, RIGHT),
    "head": SegmentAxes("head", None, None, RIGHT),
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
    for segment, of in SEGMENTS.items():
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
    return {
        segment: flip @ segment_rest_axes(of, rest_m @ flip, side) @ to_right
        for segment, of in SEGMENTS.items()
    }


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


LEAST_WEIGHTS = (0.9, 0.8, 0.6)  # skinning weights of the segment's joint, the first that one has
OFF_RAY_M = 0.03  # a vertex further from the ray is none that the ray meets


@dataclass(frozen=True)
class SurfaceMarker:
    """A marker on a segment.

    segment: by its name in `segments`. joint: whose skinning weight makes a vertex the segment's.
    share: of the way from `start` to `end`, joint centres, where the ray begins. ray: its direction
    in the rest pose of the right side (x to the body's left, y up, z forward).
    """

    segment: str
    joint: str
    start: str
    end: str
    share: float
    ray: tuple[float, float, float]


MIDDLE = {
    "head_front": SurfaceMarker("head", "head", "head", "head", 0, (0, 0.3, 1)),
    "chest": SurfaceMarker("thorax", "spine3", "spine3", "neck", 0.3, (0, 0, 1)),
    "upper_back": SurfaceMarker("thorax", "spine3", "spine3", "neck", 0.3, (0, 0, -1)),
    "pelvis_back": SurfaceMarker("pelvis", "pelvis", "pelvis", "spine1", 0.3, (0, 0, -1)),
}
SIDED = {
    "head_side": SurfaceMarker("head", "head", "head", "head", 0, (-1, 0.3, 0)),
    "pelvis_front": SurfaceMarker("pelvis", "pelvis", "pelvis", "spine1", 0.3, (-1, 0, 0.7)),
    "thigh_side": SurfaceMarker("thigh", "hip", "hip", "knee", 0.5, (-1, 0, 0)),
    "thigh_front": SurfaceMarker("thigh", "hip", "hip", "knee", 0.5, (0, 0, 1)),
    "shank_side": SurfaceMarker("shank", "knee", "knee", "ankle", 0.5, (-1, 0, 0)),
    "shank_front": SurfaceMarker("shank", "knee", "knee", "ankle", 0.5, (0, 0, 1)),
    "heel": SurfaceMarker("foot", "ankle", "ankle", "ankle", 0, (0, -1, -1)),
    "foot_side": SurfaceMarker("foot", "ankle", "ankle", "foot", 0.5, (-1, 0, 0)),
    "upper_arm_top": SurfaceMarker("humerus", "shoulder", "shoulder", "elbow", 0.5, (0, 1, 0)),
    "upper_arm_back": SurfaceMarker("humerus", "shoulder", "shoulder", "elbow", 0.5, (0, 0, -1)),
    "hand_thumb_side": SurfaceMarker("hand", "wrist", "wrist", "hand", 0.8, (0, 0, 1)),
    "hand_little_side": SurfaceMarker("hand", "wrist", "wrist", "hand", 0.8, (0, 0, -1)),
}


def surface_markers() -> dict[str, SurfaceMarker]:
    """All markers by name: those of the middle, then `left_` and `right_` of each of the sides'."""
    sided = {f"{side}_{name}": of for name, of in SIDED.items() for side in SIDES}
    return MIDDLE | sided


def marker_vertices(
    template_m: Float[np.ndarray, "V 3"],
    weights: Float[np.ndarray, "V J"],
    joints_m: Float[np.ndarray, "J 3"],
    joint_names: Sequence[str],
) -> dict[str, int]:
    """The vertex of every marker of `surface_markers`.

    Args:
        template_m, joints_m: vertices and joint centres of the rest pose (a T pose, y up, facing
            +z), metres. weights: skinning weights.

    ValueError names a marker whose ray meets no vertex of its segment.
    """
    vertices = {}
    for name, of in surface_markers().items():
        side = name.partition("_")[0] if name.startswith(SIDES) else ""
        index = {
            part: joint_names.index(part if part in joint_names else f"{side}_{part}")
            for part in (of.joint, of.start, of.end)
        }
        start, end = joints_m[index[of.start]], joints_m[index[of.end]]
        ray = np.array(of.ray) * ([-1, 1, 1] if side == "left" else [1, 1, 1])
        vertex = _met(
            template_m, weights[:, index[of.joint]], start + of.share * (end - start), ray
        )
        if vertex is None:
            raise ValueError(f"the surface has no place for the marker {name}")
        vertices[name] = vertex
    return vertices


def _met(
    template_m: Float[np.ndarray, "V 3"],
    weight: Float[np.ndarray, " V"],
    start: Float[np.ndarray, "3"],
    ray: Float[np.ndarray, "3"],
) -> int | None:
    """The vertex nearest to a ray, of those of the segment that are most nearly rigid with it."""
    from_start, direction = template_m - start, ray / np.linalg.norm(ray)
    along = from_start @ direction
    off = np.linalg.norm(from_start - along[:, None] * direction, axis=1)
    for least in LEAST_WEIGHTS:
        near = (weight >= least) & (along > 0) & (off < OFF_RAY_M)
        if near.any():
            return int(np.where(near, off, np.inf).argmin())
    return None
