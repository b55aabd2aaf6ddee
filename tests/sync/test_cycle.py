"""Cycle consistency: clean maps stay, noise falls, and softmap is what its formula says."""

import numpy as np
import pytest

from imocap_core.sync.cycle import (
    als,
    relax,
    row_contrast,
    row_stochastic,
    shrink_spectrum,
    softmap,
    svt,
    symmetric_affinity,
)
from imocap_core.sync.maps import BandedMap, BlockMaps, Blocks
from imocap_core.sync.warp.dtw import dtw, positions_of_rows

RNG = np.random.default_rng


def permutation_scene(
    rng: np.random.Generator, noise: float
) -> tuple[np.ndarray, np.ndarray, Blocks]:
    """Four videos of 20 to 28 out of 30 moments: true matches (N, N) and the same with wrong ones
    added."""
    moments = [np.sort(rng.choice(30, n, replace=False)) for n in (20, 24, 26, 28)]
    blocks = Blocks(tuple(len(m) for m in moments))
    every = np.concatenate(moments)
    truth = (every[:, None] == every[None, :]).astype(float)
    noisy = truth.copy()
    for i, j in blocks.pairs():
        block = blocks.block(noisy, i, j)
        wrong = rng.random(len(block)) < noise
        block[wrong] = np.roll(block[wrong], rng.integers(2, 8), axis=1)
        blocks.block(noisy, j, i)[...] = block.T
    return truth, noisy, blocks


def softmap_naive(affinity: np.ndarray, blocks: Blocks) -> np.ndarray:
    """One composition, block by block, frame by frame."""
    M = len(blocks.lengths)
    P = {
        (i, j): np.asarray(blocks.block(affinity, i, j)).copy() for i in range(M) for j in range(M)
    }
    for i in range(M):
        P[i, i] = np.eye(blocks.lengths[i])
    info = {}
    for key, p in P.items():
        p /= p.sum(axis=1, keepdims=True)
        entropy = -(p * np.log(np.maximum(p, 1e-30))).sum(axis=1)
        info[key] = np.clip(1 - entropy / np.log(p.shape[1]), 1e-6, 1.0)
    out = np.zeros((blocks.total, blocks.total))
    for i in range(M):
        for j in range(M):
            new = sum(
                np.diag(info[i, k]) @ P[i, k] @ np.diag(info[k, j]) @ P[k, j] for k in range(M)
            )
            new = np.eye(blocks.lengths[i]) if i == j else new
            blocks.block(out, i, j)[...] = new / new.sum(axis=1, keepdims=True)
    return out


def test_softmap_is_its_formula() -> None:
    blocks = Blocks((4, 5, 6))
    affinity = RNG(0).random((15, 15)) + 0.01
    relaxed, report = softmap(BlockMaps.of(affinity, blocks), rounds=1)
    np.testing.assert_allclose(relaxed.dense(), softmap_naive(affinity, blocks), atol=1e-5)
    assert len(report.change) == 1


def wrong_matches(matrix: np.ndarray, truth: np.ndarray, blocks: Blocks) -> int:
    """Frames with a counterpart whose best entry is another frame, over all pairs."""
    count = 0
    for i, j in blocks.pairs():
        right = np.asarray(blocks.block(truth, i, j))
        best = np.asarray(blocks.block(matrix, i, j)).argmax(axis=1)
        count += int((right.any(axis=1) & (best != right.argmax(axis=1))).sum())
    return count


@pytest.mark.parametrize("method", ["als", "svt"])
def test_wrong_matches_fall(method: str) -> None:
    truth, noisy, blocks = permutation_scene(RNG(1), noise=0.25)
    maps, report = relax(method, BlockMaps.of(noisy, blocks), rounds=2, rng=RNG(2))
    relaxed = maps.dense()
    assert wrong_matches(noisy, truth, blocks) > 20
    assert wrong_matches(relaxed, truth, blocks) < 0.7 * wrong_matches(noisy, truth, blocks)
    assert report.method == method
    assert report.status


def test_softmap_sharpens_noisy_soft_maps() -> None:
    rng = RNG(7)
    phases = [np.sort(rng.random(60)) for _ in range(4)]
    blocks = Blocks((60,) * 4)
    every = np.concatenate(phases)
    blurred = every[:, None] - every[None, :] + 0.04 * rng.normal(size=(240, 240))
    maps = BlockMaps.of(np.exp(-0.5 * (blurred / 0.03) ** 2), blocks)
    relaxed, _ = softmap(maps)

    def error(maps: BlockMaps) -> float:
        errors = [
            row_stochastic(maps.pair(i, j)).dense() @ phases[j] - phases[i]
            for i, j in blocks.pairs()
        ]
        return float(np.mean(np.abs(errors)))

    assert error(relaxed) < 0.95 * error(maps)


@pytest.mark.parametrize("method", ["als", "svt"])
def test_relaxed_matrix_is_symmetric_bounded_with_identity_blocks(method: str) -> None:
    _, noisy, blocks = permutation_scene(RNG(3), noise=0.3)
    X, report = als(noisy, blocks, rng=RNG(0)) if method == "als" else svt(noisy, blocks)
    np.testing.assert_allclose(X, X.T, atol=1e-6)
    assert X.min() >= 0
    assert X.max() <= 1
    for v, n in enumerate(blocks.lengths):
        np.testing.assert_array_equal(blocks.block(X, v, v), np.eye(n))
    assert len(report.change) <= 50


def test_shrinking_the_spectrum_is_soft_thresholding_of_singular_values() -> None:
    A = RNG(4).normal(size=(9, 9))
    A = A + A.T
    U, s, Vt = np.linalg.svd(A)
    np.testing.assert_allclose(
        shrink_spectrum(A.copy(), 1.5), (U * np.maximum(s - 1.5, 0)) @ Vt, atol=1e-9
    )


def test_a_row_without_affinity_is_uniform() -> None:
    matrix = np.eye(2, 4)
    matrix[0] = 0.0
    np.testing.assert_allclose(row_stochastic(BandedMap.of(matrix)).dense()[0], 0.25)


def test_an_uninformative_video_does_not_blur_the_others() -> None:
    truth, _, blocks = permutation_scene(RNG(5), noise=0.0)
    dark = truth.copy()
    for v in (0, 1, 2):
        blocks.block(dark, 3, v)[...], blocks.block(dark, v, 3)[...] = 1.0, 1.0
    relaxed, _ = softmap(BlockMaps.of(dark, blocks))
    matching = relaxed.block(0, 1)[np.asarray(blocks.block(truth, 0, 1)) > 0]
    assert matching.min() > 0.9


def test_two_videos_have_no_cycle() -> None:
    maps = BlockMaps.of(np.eye(6), Blocks((3, 3)))
    same, report = relax("softmap", maps, rounds=2, rng=RNG(0))
    assert same is maps
    assert "fewer than three" in report.status


def test_symmetric_affinity() -> None:
    blocks = Blocks((3, 4))
    out = symmetric_affinity(RNG(0).random((7, 7)), blocks)
    np.testing.assert_array_equal(out, out.T)
    assert out.max() <= 1


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
    # ADMM on -<S - alpha, X> + lambda |Q|_*, X in C, X = Q, with a whole SVD each step
    X, mu, Y, residuals = in_c(S, blocks), 64.0, np.zeros_like(S), []
    W = X - ALPHA
    for _ in range(20):
        U, s, Vt = np.linalg.svd(X + Y / mu)
        Q = U @ np.diag(np.maximum(s - LAMBDA / mu, 0)) @ Vt
        before, X = X, in_c(Q - (Y - W) / mu, blocks)
        Y = Y + mu * (X - Q)
        primal, dual = (np.sqrt(((X - P) ** 2).sum()) / len(S) for P in (Q, before))
        residuals.append(max(primal, mu * dual))
        mu = next_mu(mu, primal, mu * dual)
    np.testing.assert_allclose(fast, X, atol=2e-4)
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
