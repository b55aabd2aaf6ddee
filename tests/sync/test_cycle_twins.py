"""als and svt against naive twins: whole decompositions, one column at a time, float64."""

import numpy as np
import pytest

from imocap_core.sync.cycle import als, relax, row_contrast, svt, symmetric_affinity
from imocap_core.sync.maps import BlockMaps, Blocks
from imocap_core.sync.warp.dtw import dtw, positions_of_rows

RNG = np.random.default_rng
ALPHA, LAMBDA = 0.1, 1.0


def soft_scene(rng: np.random.Generator, noise: float = 0.05) -> tuple[np.ndarray, Blocks]:
    """Distances (N, N) between the phases of three videos of 12 to 16 frames, disturbed."""
    phases = [np.sort(rng.random(n)) for n in (12, 14, 16)]
    every = np.concatenate(phases)
    off = every[:, None] - every[None, :] + noise * rng.normal(size=(len(every), len(every)))
    return np.abs(off), Blocks(tuple(map(len, phases)))


def in_c(matrix: np.ndarray, blocks: Blocks) -> np.ndarray:
    """The nearest matrix of C, entry by entry."""
    video = np.repeat(np.arange(len(blocks.lengths)), blocks.lengths)
    out = np.empty_like(matrix)
    for i in range(len(matrix)):
        for j in range(len(matrix)):
            mean = (matrix[i, j] + matrix[j, i]) / 2
            out[i, j] = float(i == j) if video[i] == video[j] else min(max(mean, 0.0), 1.0)
    return out


def next_mu(mu: float, primal: float, dual: float) -> float:
    return 2 * mu if primal > 10 * dual else mu / 2 if dual > 10 * primal else mu


def svt_naive(S: np.ndarray, blocks: Blocks, steps: int) -> tuple[np.ndarray, list[float]]:
    """ADMM on -<S - alpha, X> + lambda |Q|_*, X in C, X = Q, with a whole SVD each step."""
    X, mu, Y, residuals = in_c(S, blocks), 64.0, np.zeros_like(S), []
    W = X - ALPHA
    for _ in range(steps):
        U, s, Vt = np.linalg.svd(X + Y / mu)
        Q = U @ np.diag(np.maximum(s - LAMBDA / mu, 0)) @ Vt
        before, X = X, in_c(Q - (Y - W) / mu, blocks)
        Y = Y + mu * (X - Q)
        primal, dual = (np.sqrt(((X - P) ** 2).sum()) / len(S) for P in (Q, before))
        residuals.append(max(primal, mu * dual))
        mu = next_mu(mu, primal, mu * dual)
    return X, residuals


def als_naive(
    S: np.ndarray, blocks: Blocks, rank: int, steps: int, rng: np.random.Generator
) -> tuple[np.ndarray, list[float]]:
    """The same with Q = A B', every row of a factor by its own least squares with ridge rows."""
    Z, mu, Y, residuals = in_c(S, blocks), 64.0, np.zeros_like(S), []
    W, A = Z - ALPHA, Z @ rng.standard_normal((len(S), rank), dtype=np.float32).astype(float) / 10

    def solved(factor: np.ndarray, target: np.ndarray, ridge: float) -> np.ndarray:
        system = np.vstack([factor, np.sqrt(ridge) * np.eye(rank)])
        return np.array(
            [np.linalg.lstsq(system, np.r_[c, np.zeros(rank)], rcond=None)[0] for c in target.T]
        )

    for _ in range(steps):
        target = Z + (W - Y) / mu
        B = solved(A, target, LAMBDA / mu)
        A = solved(B, target.T, LAMBDA / mu)
        X = A @ B.T
        before, Z = Z, in_c(X + Y / mu, blocks)
        Y = Y + mu * (X - Z)
        primal, dual = (np.sqrt(((Z - P) ** 2).sum()) / len(S) for P in (X, before))
        residuals.append(max(primal, mu * dual))
        mu = next_mu(mu, primal, mu * dual)
    return Z, residuals


def affinity_of(seed: int) -> tuple[np.ndarray, Blocks]:
    off, blocks = soft_scene(RNG(seed))
    return symmetric_affinity(np.exp(-0.5 * (off / 0.1) ** 2), blocks), blocks


@pytest.mark.parametrize("seed", [0, 1])
def test_svt_is_its_naive_twin(seed: int) -> None:
    S, blocks = affinity_of(seed)
    fast, report = svt(S, blocks, nuclear_weight=LAMBDA, tolerance=0.0, max_iterations=20)
    slow, residuals = svt_naive(S, blocks, 20)
    np.testing.assert_allclose(fast, slow, atol=2e-4)
    np.testing.assert_allclose(report.change, residuals, rtol=1e-2, atol=1e-5)


@pytest.mark.parametrize("seed", [0, 1])
def test_als_is_its_naive_twin(seed: int) -> None:
    S, blocks = affinity_of(seed)
    fast, report = als(
        S, blocks, rng=RNG(3), nuclear_weight=LAMBDA, tolerance=0.0, max_iterations=20
    )
    slow, residuals = als_naive(S, blocks, 32, 20, RNG(3))
    np.testing.assert_allclose(fast, slow, atol=2e-3)
    np.testing.assert_allclose(report.change, residuals, rtol=5e-2, atol=1e-4)


def test_als_and_svt_solve_one_convex_problem() -> None:
    S, blocks = affinity_of(2)

    def objective(X: np.ndarray) -> float:
        return float(-((in_c(S, blocks) - ALPHA) * X).sum() + LAMBDA * np.linalg.norm(X, "nuc"))

    choice = {"nuclear_weight": LAMBDA, "tolerance": 1e-4, "max_iterations": 2000}
    # a rank of 9 times the longest clip is no bound
    by_als, als_report = als(S, blocks, rng=RNG(0), rank_factor=9.0, **choice)  # type: ignore[arg-type]
    by_svt, svt_report = svt(S, blocks, **choice)  # type: ignore[arg-type]
    assert als_report.converged
    assert svt_report.converged
    assert objective(by_als) == pytest.approx(objective(by_svt), rel=1e-3)
    assert objective(by_svt) < objective(in_c(S, blocks))


@pytest.mark.parametrize("method", ["als", "svt"])
def test_the_report_states_whether_the_residuals_are_below_the_tolerance(method: str) -> None:
    S, blocks = affinity_of(3)
    for most, within in ((3, False), (2000, True)):
        choice = {"nuclear_weight": LAMBDA, "tolerance": 1e-4, "max_iterations": most}
        _, report = (
            als(S, blocks, rng=RNG(0), **choice)  # type: ignore[arg-type]
            if method == "als"
            else svt(S, blocks, **choice)  # type: ignore[arg-type]
        )
        assert report.converged is within
        assert (report.change[-1] < 1e-4) is within
        assert min(report.change[:-1], default=1.0) >= 1e-4
        assert ("not converged" in report.status) is not within
        assert (f"residual {report.change[-1]:.2g}" in report.status) is not within


def test_contrast_is_blind_to_a_constant_and_to_scale() -> None:
    _, blocks = soft_scene(RNG(4))
    maps = RNG(5).random((blocks.total, blocks.total))
    np.testing.assert_allclose(row_contrast(0.3 * maps + 0.4, blocks), row_contrast(maps, blocks))
    flat = np.full_like(maps, 0.4)
    np.testing.assert_array_equal(row_contrast(flat, blocks), np.eye(blocks.total))


@pytest.mark.parametrize("method", ["als", "svt"])
def test_a_reciprocal_affinity_is_not_flattened(method: str) -> None:
    """Unrelated frames have a reciprocal affinity of a third: above alpha, and yet no match."""
    T = 50
    phase = np.linspace(0, 1, T)
    off = np.abs(np.tile(phase, 4)[:, None] - np.tile(phase, 4)[None, :])
    off = off + 0.05 * RNG(6).random(off.shape)
    blocks = Blocks((T,) * 4)
    maps = BlockMaps.of(1 / (1 + off / 0.3), blocks)
    relaxed, _ = relax(method, maps, rounds=2, rng=RNG(7))
    path, _ = dtw(-relaxed.block(0, 1))
    assert np.abs(positions_of_rows(path, T) - np.arange(T)).mean() < 2.0
