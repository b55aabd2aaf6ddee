"""Distortion of a posed surface against its shape at rest; needs no truth."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

STRETCH_LIMIT = 0.4
"""Relative change of length beyond which an edge counts as stretched."""

_EDGES_AT_ONCE = 1024  # whose lengths in all frames stay in the processor's cache


def edges_of(faces: Int[np.ndarray, "F 3"]) -> Int[np.ndarray, "E 2"]:
    """The edges of a triangle mesh, each once, as pairs of vertex indices."""
    return np.asarray(np.unique(np.sort(_directed_edges(faces), axis=1), axis=0))


def stretched_edge_shares(
    vertices_m: Float[np.ndarray, "T V 3"],
    rest_m: Float[np.ndarray, "V 3"],
    edges: Int[np.ndarray, "E 2"],
) -> Float[np.ndarray, " T"]:
    """Share (0 to 1) of a frame's edges longer or shorter than at rest by more than 40 %.

    A measure of this project: a pose that linear blend skinning tears or creases. Invariant to a
    rigid motion of each frame, and to a common scale of both surfaces. Edges without length at rest
    are left out.
    """
    at_rest = _squared_lengths(rest_m.T, edges)
    used = at_rest > 0
    some, squared = edges[used], at_rest[used]
    shortest, longest = (1 - STRETCH_LIMIT) ** 2 * squared, (1 + STRETCH_LIMIT) ** 2 * squared
    stretched = np.zeros(len(vertices_m), dtype=np.int64)
    by_vertex = np.ascontiguousarray(vertices_m.T)  # a vertex's frames in a row
    for first in range(0, len(some), _EDGES_AT_ONCE):
        part = slice(first, first + _EDGES_AT_ONCE)
        lengths = _squared_lengths(by_vertex, some[part])
        outside = (lengths < shortest[part, None]) | (lengths > longest[part, None])
        stretched += np.count_nonzero(outside, axis=0)
    return stretched / len(some)


def closed_part(
    faces: Int[np.ndarray, "F 3"], part: Bool[np.ndarray, " V"]
) -> tuple[Int[np.ndarray, "G 3"], Int[np.ndarray, "B 3"]]:
    """A part of a mesh and its open ends.

    Returns:
        The faces whose three vertices are all in `part`; and the directed edges of their open ends
        as rows (from, to, end), `end` counting the connected ends (cuts at the neck, thighs...).
    """
    inside = faces[part[faces].all(axis=1)]
    directed = _directed_edges(inside)
    count = len(part)
    codes, reverse = (directed @ np.array(w) for w in ((count, 1), (1, count)))
    rim = directed[~np.isin(codes, reverse)]
    links = coo_array((np.ones(len(rim)), (rim[:, 0], rim[:, 1])), shape=(count, count))
    component = connected_components(links, directed=False)[1][rim[:, 0]]
    end = np.unique(component, return_inverse=True)[1]
    return inside, np.column_stack([rim, end])


def volumes_m3(
    vertices_m: Float[np.ndarray, "*batch V 3"],
    faces: Int[np.ndarray, "G 3"],
    open_ends: Int[np.ndarray, "B 3"],
) -> Float[np.ndarray, "*batch"]:
    """Volume inside a part of a surface, each open end closed by a fan about its edges' middle.

    By the divergence theorem, as the sum of signed tetrahedra (Zhang and Chen, "Efficient feature
    extraction for 2D/3D objects in mesh representation", ICIP 2001). Invariant to a rigid motion.

    Args:
        faces, open_ends: of `closed_part`.
    """
    volume = _signed(*(vertices_m[..., faces[:, i], :] for i in range(3)))
    for end in np.unique(open_ends[:, 2]):
        a, b, _ = open_ends[open_ends[:, 2] == end].T
        first, second = vertices_m[..., a, :], vertices_m[..., b, :]
        middle = ((first + second) / 2).mean(axis=-2, keepdims=True)
        volume = volume + _signed(second, first, np.broadcast_to(middle, first.shape))
    return np.asarray(volume)


def _directed_edges(faces: np.ndarray) -> np.ndarray:
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def _squared_lengths(
    axes_m: Float[np.ndarray, "3 V *frames"], edges: Int[np.ndarray, "E 2"]
) -> Float[np.ndarray, "E *frames"]:
    first, second = np.ascontiguousarray(edges.T)
    x, y, z = (np.square(axis.take(first, 0) - axis.take(second, 0)) for axis in axes_m)
    return np.asarray(x + y + z)


def _signed(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Sum of the signed volumes of tetrahedra from the origin."""
    return np.asarray(np.einsum("...fc,...fc->...", a, np.cross(b, c)) / 6)
