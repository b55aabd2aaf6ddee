"""Surface markers: vertices of the body that move with one segment, for programs that want markers.

A marker lies where a ray from a point on the segment's long axis leaves the body at rest. Vertices
that skinning shares between segments are left out, so that a marker is rigid with its segment;
none is a palpated landmark, and names say so (`thigh_front`, not a bone).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.conventions import SIDES

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
