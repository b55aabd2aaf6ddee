"""Surface and camera of a motion clip: a skinned mesh, and a camera that turns and zooms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from imocap_core.body.model import Shaped

INFLUENCES = 4  # joints per vertex, the most that every program reads


@dataclass(frozen=True, eq=False)
class Skin:
    """A mesh at rest with skinning weights, without pose blend shapes.

    vertices: metres from the pelvis at rest. joints: indices of the joints that move each vertex,
    weights: theirs, summing to 1.
    """

    vertices: Float[np.ndarray, "V 3"]
    faces: Int[np.ndarray, "F 3"]
    joints: Int[np.ndarray, "V 4"]
    weights: Float[np.ndarray, "V 4"]


@dataclass(frozen=True, eq=False)
class ClipCamera:
    """A camera that may turn, zoom and move.

    K: pixels, of the first frame. zoom: focal length over K's, per frame of the clip or one. size:
    width, height. R_cam_from_world: per frame of the clip, or one when it never turns. centre:
    world, metres, likewise.
    """

    id: str
    K: Float[np.ndarray, "3 3"]
    zoom: Float[np.ndarray, " _"]
    size: tuple[int, int]
    R_cam_from_world: Float[np.ndarray, "_ 3 3"]
    centre: Float[np.ndarray, "_ 3"]


def skin_of(shaped: Shaped) -> Skin:
    """The surface of a shaped body, with the four largest weights of every vertex."""
    weights = shaped.model.weights.numpy()
    order = np.argsort(-weights, axis=1, kind="stable")[:, :INFLUENCES]
    if order.shape[1] < INFLUENCES:
        order = np.pad(order, ((0, 0), (0, INFLUENCES - order.shape[1])))
        largest = np.take_along_axis(weights, order, axis=1)
        largest[:, weights.shape[1] :] = 0.0
    else:
        largest = np.take_along_axis(weights, order, axis=1)
    largest = largest / largest.sum(1, keepdims=True)
    return Skin(
        vertices=(shaped.vertices_rest - shaped.joints_rest[0]).numpy(),
        faces=shaped.model.faces.numpy(),
        joints=np.where(largest > 0, order, 0),
        weights=largest,
    )


def vertex_normals(
    vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]
) -> Float[np.ndarray, "V 3"]:
    """Unit normals: the mean of a vertex's face normals, weighted by area."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    of_faces = np.cross(b - a, c - a)
    total = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(total, faces[:, k], of_faces)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    up = np.array([0.0, 1.0, 0.0])  # of a vertex without faces
    return np.where(length > 0, total / np.maximum(length, 1e-300), up)
