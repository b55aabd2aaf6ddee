"""Light on a surface: vertex normals and a two-term lamp."""

from dataclasses import dataclass

import numpy as np

from imocap_core.render.arrays import Floats, Ints


@dataclass(frozen=True)
class Light:
    """A lamp far away and a sky above. Directions are unit vectors in the mesh's world axes.

    towards_lamp: from the surface to the lamp; up: where the sky is; ambient, diffuse, sky: weights
    that should sum to about 1, so that a face turned to the light keeps its own color.
    """

    towards_lamp: tuple[float, float, float] = (0.3, -0.5, 0.81)
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    ambient: float = 0.35
    diffuse: float = 0.5
    sky: float = 0.25

    def intensity(self, normals: Floats) -> Floats:
        """Brightness factor (...,) of surfaces with unit normals (..., 3)."""
        lamp = np.clip(normals @ np.asarray(self.towards_lamp), 0.0, None)
        above = 0.5 + 0.5 * (normals @ np.asarray(self.up))
        return self.ambient + self.diffuse * lamp + self.sky * above


def vertex_normals(vertices: Floats, faces: Ints) -> Floats:
    """Unit normals (V, 3), outward where faces run counter-clockwise; area-weighted."""
    corners = vertices[faces]
    face_normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat = faces.ravel()
    summed = np.stack(
        [
            np.bincount(flat, np.repeat(face_normals[:, k], 3), minlength=len(vertices))
            for k in range(3)
        ],
        axis=1,
    )
    length = np.linalg.norm(summed, axis=1, keepdims=True)
    return summed / np.where(length > 0, length, 1.0)
