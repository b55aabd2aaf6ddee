"""Stretched edges and volumes of a cube, and what both are invariant to."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.metrics.whole_body import closed_part, edges_of, stretched_edge_shares, volumes_m3

CUBE = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
_SQUARES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
FACES = np.array([t for a, b, c, d in _SQUARES for t in ((a, b, c), (a, c, d))])
R = Rotation.from_euler("xyz", [20, -50, 110], degrees=True).as_matrix()


def test_every_edge_counts_once() -> None:
    assert edges_of(FACES).shape == (12 + 6, 2)  # edges and one diagonal a square


def test_share_by_hand() -> None:
    # Twice as high: 4 edges of height are 100 % longer, 4 upright diagonals 58 %, 10 others not.
    high = CUBE * [1.0, 1.0, 2.0]
    shares = stretched_edge_shares(np.stack([CUBE, high, 1.3 * CUBE]), CUBE, edges_of(FACES))
    np.testing.assert_allclose(shares, [0.0, 8 / 18, 0.0])
    shrunk = stretched_edge_shares(0.5 * CUBE[None], CUBE, edges_of(FACES))
    np.testing.assert_allclose(shrunk, [1.0])


def test_share_forgives_a_rigid_motion_and_a_common_scale() -> None:
    bent = (CUBE * [1.0, 1.0, 2.0])[None]
    edges = edges_of(FACES)
    expected = stretched_edge_shares(bent, CUBE, edges)
    moved = stretched_edge_shares(3 * (bent @ R.T) + 7, 3 * CUBE, edges)
    np.testing.assert_allclose(moved, expected)


def test_share_is_that_of_edge_by_edge() -> None:
    moved = CUBE + np.random.default_rng(2).normal(scale=0.4, size=(6, 8, 3))
    edges = edges_of(FACES)
    at_rest = [np.linalg.norm(CUBE[a] - CUBE[b]) for a, b in edges]
    for vertices, share in zip(moved, stretched_edge_shares(moved, CUBE, edges), strict=True):
        lengths = [np.linalg.norm(vertices[a] - vertices[b]) for a, b in edges]
        changes = [abs(now / rest - 1) for now, rest in zip(lengths, at_rest, strict=True)]
        assert share == np.mean([change > 0.4 for change in changes])
        assert 0 < share < 1


def test_an_edge_without_length_is_left_out() -> None:
    rest = CUBE.copy()
    rest[1] = rest[0]
    shares = stretched_edge_shares(CUBE[None], rest, np.array([[0, 1], [2, 3]]))
    np.testing.assert_allclose(shares, [0.0])


def test_volume_of_a_closed_cube() -> None:
    faces, ends = closed_part(FACES, np.ones(8, dtype=bool))
    assert len(faces) == 12
    assert len(ends) == 0
    volume = float(volumes_m3(2 * CUBE + 5, faces, ends))
    assert abs(volume) == pytest.approx(8.0)


def test_open_ends_are_closed_separately() -> None:
    # A tube of square section, open at both ends (x = 0 and x = 1).
    tube = FACES[4:]
    faces, ends = closed_part(tube, np.ones(8, dtype=bool))
    assert len(faces) == 8
    assert sorted(np.bincount(ends[:, 2])) == [4, 4]
    for end in (0, 1):  # each rim is a closed loop
        rim = ends[ends[:, 2] == end]
        assert sorted(rim[:, 0]) == sorted(rim[:, 1])
    volume = volumes_m3(np.stack([CUBE, CUBE @ R.T - 3, CUBE * [2, 1, 1]]), faces, ends)
    np.testing.assert_allclose(np.abs(volume), [1.0, 1.0, 2.0])


def test_a_part_leaves_out_faces_that_are_not_wholly_in_it() -> None:
    faces, ends = closed_part(FACES, CUBE[:, 2] < 0.5)
    assert len(faces) == 2  # the square z = 0
    assert len(ends) == 4
