"""Surfaces of recovered and true bodies: vertex errors, stretch, torso volume, feet."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
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
from imocap_core.metrics.whole_body import pa_pve_mm, pve_mm

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
class Distortion:
    """Per frame: the share of stretched edges, and the torso's volume relative to rest."""

    stretched_shares: Float[np.ndarray, " T"]
    torso_volumes: Float[np.ndarray, " T"]


@lru_cache(maxsize=2)
def surface_mesh(model: Model) -> SurfaceMesh:
    """Edges and torso of a body model.

    A vertex belongs to the torso when its largest skinning weight is that of a joint of TORSO.
    """
    faces = model.faces.numpy()
    torso = [model.joint_names.index(name) for name in TORSO]
    part = np.isin(model.weights.argmax(dim=1).numpy(), torso)
    return SurfaceMesh(edges_of(faces), *closed_part(faces, part))


def distortion(posed: Posed, mesh: SurfaceMesh) -> Distortion:
    """Distortion of a body's surface against the same person's at rest."""
    rest = posed.shaped.vertices_rest.numpy()
    at_rest = volumes_m3(rest, mesh.torso_faces, mesh.torso_ends)
    shares, volumes = [np.zeros(0)], [np.zeros(0)]
    for (vertices,) in _surfaces(posed):
        shares.append(stretched_edge_shares(vertices, rest, mesh.edges))
        volumes.append(volumes_m3(vertices, mesh.torso_faces, mesh.torso_ends) / at_rest)
    return Distortion(np.concatenate(shares), np.concatenate(volumes))


@dataclass(frozen=True)
class VertexErrors:
    """PVE about the hips' middle, the same without hands, and after Procrustes; mm."""

    pve: float
    pve_without_hands: float
    pa_pve: float


def vertex_errors_mm(predicted: Posed, true: Posed) -> VertexErrors:
    """Per-vertex errors, means over vertices and frames; NaN without frames."""
    model = predicted.shaped.model
    roots = [hip_midpoint(body.joints.numpy(), model.joint_names) for body in (predicted, true)]
    rest = ~_hand_vertices(model)
    errors, counts = [], []
    for start, pair in enumerate(_surfaces(predicted, true)):
        part = slice(_CHUNK * start, _CHUNK * (start + 1))
        places = [root[part] for root in roots]
        without = pve_mm(*(surface[:, rest] for surface in pair), *places)
        errors.append((pve_mm(*pair, *places), without, pa_pve_mm(*pair)))
        counts.append(len(pair[0]))
    means = np.average(errors, axis=0, weights=counts) if counts else np.full(3, np.nan)
    return VertexErrors(*(float(mean) for mean in means))


def _hand_vertices(model: Model) -> Bool[np.ndarray, " V"]:
    """Vertices whose largest skinning weight is that of a wrist or a joint beyond it."""
    beyond = [j for j, name in enumerate(model.joint_names) if _is_of_hand(name)]
    return np.isin(model.weights.argmax(dim=1).numpy(), beyond)


def _is_of_hand(joint: str) -> bool:
    return any(part in joint for part in HAND_PARTS)


def foot_points_m(posed: Posed) -> Float[np.ndarray, "T 4 3"]:
    """Heel and big toe of both feet, on the surface."""
    return np.asarray(posed.keypoints(_foot_points(posed.shaped.model)).numpy())


def _foot_points(model: Model) -> PointSet:
    return pick_points(model.points("body25"), FOOT_POINTS)


def _surfaces(*bodies: Posed) -> Iterator[tuple[Float[np.ndarray, "t V 3"], ...]]:
    """Vertices of the bodies, some frames at a time."""
    for start in range(0, len(bodies[0].transl), _CHUNK):
        part = slice(start, start + _CHUNK)
        yield tuple(
            body.shaped.pose(body.R_local[part], body.transl[part]).mesh().vertices.numpy()
            for body in bodies
        )
