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
    front, corners = _front_faces(xy_px, depth, faces)
    (left, right), (top, bottom) = map(_pixels_between, corners, size)
    columns = np.maximum(right - left + 1, 0)
    rows = np.where(columns > 0, np.maximum(bottom - top + 1, 0), 0)

    row_owner, row_step = _spread(rows)  # the boxes' rows, then the rows' pixels
    row_y = top[row_owner] + row_step
    row, step = _spread(columns[row_owner])
    x = left[row_owner][row] + step
    weight_1, weight_2 = (
        (along_x[row_owner][row] * x + (along_y[row_owner] * row_y)[row]) + offset[row_owner][row]
        for along_x, along_y, offset in _planes(corners)
    )
    weight_0 = 1.0 - weight_1 - weight_2
    inside = np.flatnonzero((weight_0 >= _EDGE) & (weight_1 >= _EDGE) & (weight_2 >= _EDGE))

    weights = [weight[inside] for weight in (weight_0, weight_1, weight_2)]
    row = row[inside]
    owner, pixel = row_owner[row], row_y[row] * width + x[inside]
    closeness_0, closeness_1, closeness_2 = (  # 1/depth is what is linear in the image
        weight * (1.0 / depth[corner])[owner]
        for weight, corner in zip(weights, faces[front].T, strict=True)
    )
    closeness = closeness_0 + closeness_1 + closeness_2

    nearest = np.zeros(width * height)
    np.maximum.at(nearest, pixel, closeness)
    winner = np.full(width * height, -1)
    visible = np.flatnonzero(closeness == nearest[pixel])
    winner[pixel[visible]] = visible  # of equally near faces the last one
    covered = np.flatnonzero(winner >= 0)
    chosen = winner[covered]
    weight = np.stack([weight[chosen] for weight in weights], axis=1)
    return Fragments(covered, front[owner[chosen]], weight, 1.0 / closeness[chosen])


def _spread(count: Int[np.ndarray, " C"]) -> tuple[np.ndarray, np.ndarray]:
    """Each index as often as it counts, and the number of each among those of its index."""
    owner = np.repeat(np.arange(len(count)), count)
    first = np.cumsum(count) - count
    return owner, np.arange(len(owner)) - first[owner]


def _front_faces(
    xy_px: Float[np.ndarray, "V 2"], depth: Float[np.ndarray, " V"], faces: Int[np.ndarray, "F 3"]
) -> tuple[Int[np.ndarray, " C"], Float[np.ndarray, "2 3 C"]]:
    """Front faces, and x and y of their three corners."""
    by_corner = np.ascontiguousarray(faces.T)
    xs, ys = (np.ascontiguousarray(axis)[by_corner] for axis in xy_px.T)
    nearest = np.minimum.reduce(depth[by_corner])
    front = np.flatnonzero((_doubled_areas(xs, ys) < 0) & (nearest > NEAR_M))
    return front, np.stack([xs.take(front, axis=1), ys.take(front, axis=1)])


def _doubled_areas(
    xs: Float[np.ndarray, "3 C"], ys: Float[np.ndarray, "3 C"]
) -> Float[np.ndarray, " C"]:
    """Twice the signed areas; y points down, so outward faces turn clockwise: negative."""
    return np.asarray((xs[1] - xs[0]) * (ys[2] - ys[0]) - (ys[1] - ys[0]) * (xs[2] - xs[0]))


def _planes(
    corners: Float[np.ndarray, "2 3 C"],
) -> list[tuple[Float[np.ndarray, " C"], Float[np.ndarray, " C"], Float[np.ndarray, " C"]]]:
    """The affine maps from pixel to 2nd and to 3rd barycentric weight: along x, along y, offset."""
    xs, ys = corners
    area = _doubled_areas(xs, ys)
    slopes = [
        ((ys[2] - ys[0]) / area, -(xs[2] - xs[0]) / area),
        (-(ys[1] - ys[0]) / area, (xs[1] - xs[0]) / area),
    ]
    return [(along_x, along_y, -(along_x * xs[0] + along_y * ys[0])) for along_x, along_y in slopes]


def _pixels_between(
    corners: Float[np.ndarray, "3 C"], count: int
) -> tuple[Int[np.ndarray, " C"], Int[np.ndarray, " C"]]:
    """First and last pixel (inclusive) of each triangle along one axis of the image."""
    low, high = np.minimum.reduce(corners), np.maximum.reduce(corners)
    first = np.clip(np.ceil(low), 0, count).astype(np.int64)
    return first, np.clip(np.floor(high), -1, count - 1).astype(np.int64)
