"""Diffuse shading: vertex normals, a directional lamp and hemispheric sky light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int


@dataclass(frozen=True)
class Light:
    """A directional lamp and a sky. Directions are unit vectors in the mesh's world axes.

    towards_lamp: from the surface to the lamp; up: towards the sky; ambient, diffuse, sky: weights
    that should sum to about 1, so that a face turned to the light has its true colour.
    """

    towards_lamp: tuple[float, float, float] = (0.3, -0.5, 0.81)
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    ambient: float = 0.35
    diffuse: float = 0.5
    sky: float = 0.25

    def intensity(self, normals: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "..."]:
        """Brightness factor of surfaces with unit normals."""
        lamp = np.clip(normals @ np.asarray(self.towards_lamp), 0.0, None)
        above = 0.5 + 0.5 * (normals @ np.asarray(self.up))
        return self.ambient + self.diffuse * lamp + self.sky * above


def vertex_normals(
    vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]
) -> Float[np.ndarray, "V 3"]:
    """Area-weighted unit normals, outward where faces are counter-clockwise."""
    axes = np.ascontiguousarray(vertices.T)
    first, second, third = (axes.take(side, axis=1) for side in np.ascontiguousarray(faces.T))
    (ax, ay, az), (bx, by, bz) = second - first, third - first
    cross = (ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)
    flat = faces.ravel()
    summed = np.stack(
        [np.bincount(flat, np.repeat(c, 3), minlength=len(vertices)) for c in cross], axis=1
    )
    length = np.linalg.norm(summed, axis=1, keepdims=True)
    return summed / np.where(length > 0, length, 1.0)
