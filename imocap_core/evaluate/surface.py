"""Surfaces of recovered and true bodies: vertex errors, stretch, torso volume, feet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float, Int

from imocap_core.body import Model, Posed
from imocap_core.body.points import PointSet, pick_points
from imocap_core.metrics.joints import hip_midpoint
from imocap_core.metrics.mesh_stretch import (
    closed_part,
    edges_of,
    stretched_edge_shares,
    volumes_m3,
)
from imocap_core.metrics.position import mean_over_frames
from imocap_core.metrics.whole_body import pa_pve_mm, vertex_distances_mm

TORSO = ("spine1", "spine2", "spine3", "left_collar", "right_collar")
"""The torso above the pelvis, whose own volume changes whenever the hips bend."""

HAND_PARTS = ("wrist", "hand", "thumb", "index", "middle", "ring", "pinky")
"""In the names of the joints that keypoints of the body say nothing of."""

FOOT_POINTS = ("left_heel", "left_big_toe", "right_heel", "right_big_toe")
_CHUNK = 32  # frames whose surfaces are in memory together


@dataclass(frozen=True)
class SurfaceMesh:
    """What the measures of a body's surface need of its mesh; see `mesh_stretch`."""

    edges: Int[np.ndarray, "E 2"]
    torso_faces: Int[np.ndarray, "G 3"]
    torso_ends: Int[np.ndarray, "B 3"]


@dataclass(frozen=True)
class VertexErrors:
    """PVE about the hips' middle, the same without hands, and after Procrustes; mm."""

    pve: float
    pve_without_hands: float
    pa_pve: float


@dataclass(frozen=True)
class SurfaceMeasures:
    """Distortion of a body's surface against the same person's at rest, and its errors.

    stretched_shares: of edges, per frame; torso_volumes: relative to rest. errors: None without
    a true surface.
    """

    stretched_shares: Float[np.ndarray, " T"]
    torso_volumes: Float[np.ndarray, " T"]
    errors: VertexErrors | None


@lru_cache(maxsize=2)
def surface_mesh(model: Model) -> SurfaceMesh:
    """Edges and torso of a body model.

    A vertex belongs to the torso when its largest skinning weight is that of a joint of TORSO.
    """
    faces = model.faces.cpu().numpy()
    torso = [model.joint_names.index(name) for name in TORSO]
    part = np.isin(model.weights.argmax(dim=1).cpu().numpy(), torso)
    return SurfaceMesh(edges_of(faces), *closed_part(faces, part))


def measure_surfaces(
    predicted: Sequence[Posed], true: Posed | None, mesh: SurfaceMesh
) -> list[SurfaceMeasures]:
    """Measures of several results of one video; each surface is skinned once.

    Errors are means over vertices and frames, NaN without frames.
    """
    bodies = [*predicted, *([] if true is None else [true])]
    parts = [slice(start, start + _CHUNK) for start in range(0, len(bodies[0].transl), _CHUNK)]
    measured: list[list[SurfaceMeasures]] = [[] for _ in predicted]
    for part in parts:
        surfaces = [_surface(body, part) for body in bodies]
        last = None if true is None else surfaces[-1]
        for measures, surface in zip(measured, surfaces, strict=False):
            errors = None if last is None else _vertex_errors_mm(surface, last)
            measures.append(_distortion(surface, mesh, errors))
    return [_of_all_frames(measures, true is not None) for measures in measured]


@dataclass(frozen=True)
class _Surface:
    """A body's surface in some frames, at rest, and its root; metres."""

    model: Model
    vertices: Float[np.ndarray, "t V 3"]
    rest: Float[np.ndarray, "V 3"]
    root: Float[np.ndarray, "t 3"]


def _surface(body: Posed, frames: slice) -> _Surface:
    shaped = body.shaped
    posed = shaped.pose(body.R_local[frames], body.transl[frames])
    root = hip_midpoint(posed.joints.cpu().numpy(), shaped.model.joint_names)
    vertices, rest = (x.cpu().numpy() for x in (posed.mesh().vertices, shaped.vertices_rest))
    return _Surface(shaped.model, vertices, rest, root)


def _distortion(
    surface: _Surface, mesh: SurfaceMesh, errors: VertexErrors | None
) -> SurfaceMeasures:
    """The measures that need no truth, beside those that do."""
    volumes = volumes_m3(surface.vertices, mesh.torso_faces, mesh.torso_ends)
    return SurfaceMeasures(
        stretched_edge_shares(surface.vertices, surface.rest, mesh.edges),
        volumes / volumes_m3(surface.rest, mesh.torso_faces, mesh.torso_ends),
        errors,
    )


def _vertex_errors_mm(predicted: _Surface, true: _Surface) -> VertexErrors:
    """Means over the frames of two surfaces."""
    pair = predicted.vertices, true.vertices
    distances = vertex_distances_mm(*pair, predicted.root, true.root)
    without_hands = np.compress(~_hand_vertices(predicted.model), distances, axis=1)
    return VertexErrors(
        mean_over_frames(distances), mean_over_frames(without_hands), pa_pve_mm(*pair)
    )


def _of_all_frames(parts: Sequence[SurfaceMeasures], scored: bool) -> SurfaceMeasures:
    errors = [astuple(part.errors) for part in parts if part.errors is not None]
    counts = [len(part.stretched_shares) for part in parts]
    means = np.average(errors, axis=0, weights=counts) if errors else np.full(3, np.nan)
    return SurfaceMeasures(
        np.concatenate([np.zeros(0), *(part.stretched_shares for part in parts)]),
        np.concatenate([np.zeros(0), *(part.torso_volumes for part in parts)]),
        VertexErrors(*(float(mean) for mean in means)) if scored else None,
    )


@lru_cache(maxsize=2)
def _hand_vertices(model: Model) -> Bool[np.ndarray, " V"]:
    """Vertices whose largest skinning weight is that of a wrist or a joint beyond it."""
    beyond = [j for j, name in enumerate(model.joint_names) if _is_of_hand(name)]
    return np.isin(model.weights.argmax(dim=1).cpu().numpy(), beyond)


def _is_of_hand(joint: str) -> bool:
    return any(part in joint for part in HAND_PARTS)


def foot_points_m(posed: Posed) -> Float[np.ndarray, "T 4 3"]:
    """Heel and big toe of both feet, on the surface."""
    return np.asarray(posed.keypoints(_foot_points(posed.shaped.model)).cpu().numpy())


def _foot_points(model: Model) -> PointSet:
    return pick_points(model.points("body25"), FOOT_POINTS)
