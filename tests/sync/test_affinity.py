"""Closed-form Procrustes distances against one SVD per pair, and their invariances."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.sync.affinity import reciprocal_affinity
from imocap_core.sync.procrustes import optimal_trace, procrustes_distances


def distance_naive(a: np.ndarray, b: np.ndarray, w: np.ndarray) -> float:
    """One pair, by the singular value decomposition."""
    shared = w > 0
    if shared.sum() < 3:
        return np.nan
    a, b, w = a[shared], b[shared], w[shared, None]
    a, b = a - (w * a).sum(0) / w.sum(), b - (w * b).sum(0) / w.sum()
    U, s, Vt = np.linalg.svd((w * a).T @ b)
    s[2] *= np.sign(np.linalg.det(U @ Vt))
    return float(np.sqrt(max(0.0, (w * (a * a + b * b)).sum() - 2 * s.sum()) / w.sum()))


@pytest.fixture
def poses() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(23, 14, 3)), rng.normal(size=(17, 14, 3))
    a[1] *= [1, 1, 0]  # flat
    b[2] *= [1, 0, 0]  # on a line
    b[3] = a[3] * [-1, 1, 1]  # a mirror image
    b[4] = a[4]
    wa, wb = rng.random((23, 14)), rng.random((17, 14))
    wa[wa < 0.3], wb[:, 5] = 0.0, 0.0
    a[wa == 0] = np.nan
    wa[7, 2:] = 0.0  # two joints left: nothing to align
    return a, b, wa, wb


def test_matches_one_svd_per_pair(poses) -> None:
    a, b, wa, wb = poses
    distances = procrustes_distances(a, b, wa, wb)
    naive = np.array(
        [
            [distance_naive(x, y, u * v) for y, v in zip(b, wb, strict=True)]
            for x, u in zip(a, wa, strict=True)
        ]
    )
    assert np.isnan(distances[7]).all()
    np.testing.assert_allclose(distances, naive, atol=1e-7)


def test_chunks_do_not_matter(poses) -> None:
    a, b, wa, wb = poses
    whole, pieces = (procrustes_distances(a, b, wa, wb, entries_per_chunk=n) for n in (10**6, 40))
    np.testing.assert_allclose(whole, pieces, atol=1e-12)


def test_blind_to_rigid_motion_but_not_to_mirroring() -> None:
    rng = np.random.default_rng(2)
    a, ones = rng.normal(size=(12, 20, 3)), np.ones((12, 20))
    R, t = Rotation.random(12, random_state=3).as_matrix(), rng.normal(size=(12, 1, 3))
    moved = np.einsum("nab,njb->nja", R, a) + t
    np.testing.assert_allclose(np.diag(procrustes_distances(a, moved, ones, ones)), 0.0, atol=1e-6)
    assert (np.diag(procrustes_distances(a, a * [-1, 1, 1], ones, ones)) > 0.1).all()


def test_swapping_transposes(poses) -> None:
    a, b, wa, wb = poses
    there, back = procrustes_distances(a, b, wa, wb), procrustes_distances(b, a, wb, wa)
    np.testing.assert_allclose(there, back.T, atol=1e-9)


def test_optimal_trace_of_degenerate_matrices() -> None:
    S = np.stack([np.eye(3), -np.eye(3), np.zeros((3, 3)), np.diag([2.0, 0, 0])], axis=-1)
    np.testing.assert_allclose(optimal_trace(S), [3.0, 1.0, 0.0, 2.0], atol=1e-7)


def test_affinity_falls_from_one() -> None:
    values = reciprocal_affinity(np.array([0.0, 0.1, 0.2, 5.0, np.nan]), 0.1)
    assert values[0] == 1.0
    assert values[4] == 0.0
    assert (np.diff(values[:4]) < 0).all()
    assert (values >= 0).all()


@pytest.mark.usefixtures("unchecked_shapes")
def test_shapes_are_named() -> None:
    with pytest.raises(ValueError, match="equal J"):
        procrustes_distances(
            np.zeros((2, 5, 3)), np.zeros((2, 6, 3)), np.ones((2, 5)), np.ones((2, 6))
        )
