"""What a clip is shown with besides its joints: the surface that its bones move, and its camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imocap_core.body.model import Shaped

Array = NDArray[np.float64]

INFLUENCES = 4  # joints that move one vertex, the most that every program reads


@dataclass(frozen=True, eq=False)
class Skin:
    """A surface at rest and how its bones move it, without pose blend shapes.

    vertices (V, 3) metres from the rest pelvis; faces (F, 3); joints (V, 4), weights (V, 4) that
    sum to 1.
    """

    vertices: Array
    faces: NDArray[np.int64]
    joints: NDArray[np.int64]
    weights: Array


@dataclass(frozen=True, eq=False)
class ClipCamera:
    """A camera that stands and may turn and zoom.

    K (3, 3) pixels, of the first frame; zoom (T,), one a frame, or (1,): focal length over K's;
    size: width, height; R_cam_from_world (T, 3, 3), one a frame of the clip, or (1, 3, 3) when it
    never turns; centre (3,) world, metres.
    """

    id: str
    K: Array
    zoom: Array
    size: tuple[int, int]
    R_cam_from_world: Array
    centre: Array


def skin_of(shaped: Shaped) -> Skin:
    """The surface of a body of one shape; of every vertex the four largest weights."""
    weights = shaped.model.weights.numpy()
    order = np.argsort(-weights, axis=1, kind="stable")[:, :INFLUENCES]
    if order.shape[1] < INFLUENCES:
        order = np.pad(order, ((0, 0), (0, INFLUENCES - order.shape[1])))
        kept = np.take_along_axis(weights, order, axis=1)
        kept[:, weights.shape[1] :] = 0.0
    else:
        kept = np.take_along_axis(weights, order, axis=1)
    kept = kept / kept.sum(1, keepdims=True)
    return Skin(
        vertices=(shaped.vertices_rest - shaped.joints_rest[0]).numpy(),
        faces=shaped.model.faces.numpy(),
        joints=np.where(kept > 0, order, 0),
        weights=kept,
    )


def vertex_normals(vertices: Array, faces: NDArray[np.int64]) -> Array:
    """(V, 3) unit normals: of a vertex's faces, weighted by their areas."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    of_faces = np.cross(b - a, c - a)
    total = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(total, faces[:, k], of_faces)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    up = np.array([0.0, 1.0, 0.0])  # of a vertex that no face has
    return np.where(length > 0, total / np.maximum(length, 1e-300), up)
