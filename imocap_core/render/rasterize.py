"""Triangle rasterisation: a z-buffer in plain numpy.

Every triangle proposes the pixel centres in its bounding box, all triangles at once. This is fast
for body meshes: many triangles, each a few pixels large.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

NEAR_M = 0.05
_EDGE = -1e-9  # barycentric tolerance, so that a pixel centre on a shared edge is covered


class Fragments(NamedTuple):
    """The visible surface, one entry per covered pixel.

    pixel: flat index, row * width + column. face: index into the faces. weight: barycentric weights
    of that face's corners, in the image plane. depth: metres.
    """

    pixel: Int[np.ndarray, " N"]
    face: Int[np.ndarray, " N"]
    weight: Float[np.ndarray, "N 3"]
    depth: Float[np.ndarray, " N"]


def rasterize(
    xy_px: Float[np.ndarray, "V 2"],
    depth: Float[np.ndarray, " V"],
    faces: Int[np.ndarray, "F 3"],
    size: tuple[int, int],
) -> Fragments:
    """The nearest triangle at every pixel centre of an image.

    Args:
        xy_px: projected corners; pixel (0, 0) is the centre of the first pixel.
        depth: along the optical axis, metres.
        faces: counter-clockwise from outside. Back faces are skipped, and faces with a corner
            nearer than NEAR_M.
        size: (width, height).
    """
    width, height = size
    candidates, plane = _front_faces(xy_px, depth, faces)
    low, high = _pixel_boxes(xy_px[faces[candidates]], size)
    extent = np.maximum(high - low + 1, 0)
    extent[extent[:, 0] == 0, 1] = 0  # no rows of no columns

    row_owner, row_step = _spread(extent[:, 1])  # the boxes' rows, then the rows' pixels
    row_y = low[row_owner, 1] + row_step
    row, step = _spread(extent[row_owner, 0])
    owner, y = row_owner[row], row_y[row]
    x = low[row_owner, 0][row] + step

    of_row = plane[row_owner]
    along_y = of_row[:, :, 1] * row_y[:, None]
    weight_1, weight_2 = (
        of_row[:, k, 0][row] * x + along_y[:, k][row] + of_row[:, k, 2][row] for k in range(2)
    )
    weight_0 = 1.0 - weight_1 - weight_2
    inside = (weight_0 >= _EDGE) & (weight_1 >= _EDGE) & (weight_2 >= _EDGE)

    owner, weight_0, weight_1, weight_2 = (a[inside] for a in (owner, weight_0, weight_1, weight_2))
    pixel = (y * width + x)[inside]
    corner_closeness = 1.0 / depth[faces[candidates]]  # 1/depth is what is linear in the image
    corners = corner_closeness[owner]
    closeness = weight_0 * corners[:, 0] + weight_1 * corners[:, 1] + weight_2 * corners[:, 2]

    nearest = np.zeros(width * height)
    np.maximum.at(nearest, pixel, closeness)
    winner = np.full(width * height, -1)
    visible = np.flatnonzero(closeness == nearest[pixel])
    winner[pixel[visible]] = visible  # of equally near faces the last one
    covered = np.flatnonzero(winner >= 0)
    chosen = winner[covered]
    weight = np.stack([weight_0[chosen], weight_1[chosen], weight_2[chosen]], axis=1)
    return Fragments(covered, candidates[owner[chosen]], weight, 1.0 / closeness[chosen])


def _spread(count: Int[np.ndarray, " C"]) -> tuple[np.ndarray, np.ndarray]:
    """Each index as often as it counts, and the number of each among those of its index."""
    owner = np.repeat(np.arange(len(count)), count)
    first = np.cumsum(count) - count
    return owner, np.arange(len(owner)) - first[owner]


def _front_faces(
    xy_px: Float[np.ndarray, "V 2"], depth: Float[np.ndarray, " V"], faces: Int[np.ndarray, "F 3"]
) -> tuple[Int[np.ndarray, " C"], Float[np.ndarray, "C 2 3"]]:
    """Front faces, and for each the affine map from pixel to 2nd and 3rd barycentric weight."""
    a, b, c = (xy_px[faces[:, i]] for i in range(3))
    ab, ac = b - a, c - a
    area = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]  # y points down: outward faces turn clockwise
    front = np.flatnonzero((area < 0) & (depth[faces].min(axis=1) > NEAR_M))
    a, ab, ac, area = a[front], ab[front], ac[front], area[front]
    plane = np.empty((len(front), 2, 3))
    plane[:, 0, 0], plane[:, 0, 1] = ac[:, 1] / area, -ac[:, 0] / area
    plane[:, 1, 0], plane[:, 1, 1] = -ab[:, 1] / area, ab[:, 0] / area
    plane[:, :, 2] = -(plane[:, :, 0] * a[:, None, 0] + plane[:, :, 1] * a[:, None, 1])
    return front, plane


def _pixel_boxes(
    triangles: Float[np.ndarray, "C 3 2"], size: tuple[int, int]
) -> tuple[Int[np.ndarray, "C 2"], Int[np.ndarray, "C 2"]]:
    """First and last pixel (inclusive) of each triangle's box within the image."""
    limit = np.array(size) - 1
    low = np.clip(np.ceil(triangles.min(axis=1)), 0, limit + 1).astype(np.int64)
    high = np.clip(np.floor(triangles.max(axis=1)), -1, limit).astype(np.int64)
    return low, high
