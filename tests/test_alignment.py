"""Laws of Procrustes alignment, and a slow twin for the batched code."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from imocap_core.alignment import procrustes, rigid, similarity


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


def _rotation(rng: np.random.Generator) -> np.ndarray:
    return Rotation.random(rng=rng).as_matrix()


def _naive(x: np.ndarray, y: np.ndarray, w: np.ndarray, scale: bool) -> float:
    """Least weighted squared error over rotation vectors, from several starts, by brute search."""

    def cost(p: np.ndarray) -> float:
        s = np.exp(p[6]) if scale else 1.0
        d = s * x @ Rotation.from_rotvec(p[:3]).as_matrix().T + p[3:6] - y
        return float((w * (d**2).sum(axis=1)).sum())

    starts = [np.concatenate([r, np.zeros(4)]) for r in 2.0 * np.vstack([np.eye(3), -np.eye(3)])]
    return min(minimize(cost, start, method="BFGS").fun for start in starts)


@pytest.mark.parametrize("scale", [False, True])
def test_recovers_a_known_transform(rng: np.random.Generator, scale: bool) -> None:
    x = rng.normal(size=(4, 5, 12, 3))
    R = Rotation.random(20, rng=rng).as_matrix().reshape(4, 5, 3, 3)
    s = rng.uniform(0.5, 2.0, size=(4, 5)) if scale else np.ones((4, 5))
    t = rng.normal(size=(4, 5, 3))
    y = s[..., None, None] * np.einsum("...rc,...nc->...nr", R, x) + t[..., None, :]
    alignment = procrustes(x, y, scale=scale)
    np.testing.assert_allclose(alignment.R_target_from_source, R, atol=1e-12)
    np.testing.assert_allclose(alignment.t_target, t, atol=1e-12)
    np.testing.assert_allclose(alignment.scale, s, atol=1e-12)
    np.testing.assert_allclose(alignment.apply(x), y, atol=1e-12)


@pytest.mark.parametrize("scale", [False, True])
def test_no_search_finds_a_smaller_error(rng: np.random.Generator, scale: bool) -> None:
    x, y = rng.normal(size=(6, 3)), rng.normal(size=(6, 3))
    w = rng.uniform(0.1, 1.0, size=6)
    alignment = procrustes(x, y, w, scale=scale)
    cost = float((w * ((alignment.apply(x) - y) ** 2).sum(axis=1)).sum())
    assert cost == pytest.approx(_naive(x, y, w, scale), rel=1e-6)


def test_a_mirror_image_still_yields_a_rotation(rng: np.random.Generator) -> None:
    x = rng.normal(size=(9, 3))
    R = rigid(x, x * [1, 1, -1]).R_target_from_source
    assert np.linalg.det(R) == pytest.approx(1.0)


def test_batch_equals_one_at_a_time(rng: np.random.Generator) -> None:
    x, y = rng.normal(size=(7, 10, 3)), rng.normal(size=(7, 10, 3))
    y[2, 3] = np.nan
    batch = similarity(x, y)
    for i in range(7):
        one = similarity(x[i], y[i])
        np.testing.assert_allclose(batch.R_target_from_source[i], one.R_target_from_source)
        np.testing.assert_allclose(batch.t_target[i], one.t_target)


def test_missing_points_count_as_absent(rng: np.random.Generator) -> None:
    x, y = rng.normal(size=(10, 3)), rng.normal(size=(10, 3))
    short = rigid(x[:8], y[:8]).R_target_from_source
    holed = y.copy()
    holed[8:] = np.nan
    np.testing.assert_allclose(rigid(x, holed).R_target_from_source, short)
    np.testing.assert_allclose(rigid(x, y, [1] * 8 + [0] * 2).R_target_from_source, short)


def test_two_points_give_nan_not_a_guess(rng: np.random.Generator) -> None:
    x = rng.normal(size=(2, 5, 3))
    y = x.copy()
    y[1, :3] = np.nan
    alignment = rigid(x, y)
    assert np.isfinite(alignment.t_target[0]).all()
    assert np.isnan(alignment.t_target[1]).all()
    assert np.isnan(alignment.R_target_from_source[1]).all()


def test_misuse_is_named(rng: np.random.Generator) -> None:
    x = rng.normal(size=(5, 3))
    with pytest.raises(ValueError, match="one N"):
        rigid(x, x[:4])
    with pytest.raises(ValueError, match="negative"):
        rigid(x, x, [1, 1, 1, 1, -1])
