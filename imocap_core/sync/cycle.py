"""Cycle consistency of the pairwise maps (Eq. 2): maps agree with those through a third video.

softmap: each block of the affinity, its rows scaled to sum 1, is a stochastic map P_ij. Were the
maps consistent, P_ij = P_ik P_kj for every third video k; so P_ij is replaced by the mean over all
k, a few times. With P_ii = I the direct map counts twice. Only the bands are multiplied.

als and svt solve Eq. 2 with the rank relaxed to the nuclear norm, by ADMM:

    min  -<S - alpha, X> + lambda |X|_*   subject to  X in C,

C: symmetric, entries in [0, 1], the blocks within a video the identity; S: how far each entry of
the affinity stands out in its row (the paper's reciprocal is far from 0 for unrelated poses too,
and would match all frames with all others). als is MatchALS (Zhou, Zhu, Daniilidis, ICCV 2015): the
norm as ridge penalties on two factors, X = A B', three thin products an iteration. svt (Dong et
al., CVPR 2019) shrinks singular values, which for a symmetric X are moduli of eigenvalues.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.linalg import cho_factor, cho_solve, eigh

from imocap_core.params.sync_params import CycleMethod
from imocap_core.sync.maps import BandedMap, BlockMaps, Blocks


@dataclass(frozen=True)
class CycleReport:
    """Outcome of a cycle-consistency method.

    Attributes:
        method: softmap, als, svt or none.
        converged: the last residual is below the tolerance.
        change: one number per iteration: the relative change (softmap) or the larger ADMM residual
            (als, svt).
        status: one sentence.
    """

    method: str
    converged: bool
    change: tuple[float, ...]
    status: str


def convergence_report(
    method: str, residuals: Sequence[float], tolerance: float, detail: str = ""
) -> CycleReport:
    """Outcome of an iteration that stops when the residual is below the tolerance; the status ends
    with `detail`."""
    converged = residuals[-1] < tolerance
    after = f"after {len(residuals)} iterations"
    status = (
        f"converged {after}"
        if converged
        else f"not converged {after} (residual {residuals[-1]:.2g}, {tolerance:.2g} was asked)"
    )
    return CycleReport(method, converged, tuple(residuals), f"{method}: {status}{detail}")


def row_stochastic(soft_map: BandedMap) -> BandedMap:
    """Scale the rows to sum 1; a row of zeros becomes uniform (no information)."""
    total = soft_map.row_sums()
    if (total > 0).all():
        return soft_map.mapped(
            lambda rows, _, values: values / values.sum(axis=1, keepdims=True, dtype=values.dtype)
        )
    filled = soft_map.dense()
    filled[~(total > 0)] = 1.0
    return BandedMap.of(filled / filled.sum(axis=1, keepdims=True))


def row_information(soft_map: BandedMap) -> Float[np.ndarray, " N"]:
    """Information in each row of a stochastic map, in [0, 1]: 1 - entropy / log(number of frames).

    1 = the frame is located exactly, 0 = all frames of the other video are equally likely. A map
    that carries no information would otherwise blur every map composed through it.
    """
    N, S = soft_map.shape
    if S == 1:
        return np.ones(N)
    entropy = soft_map.per_row(lambda p: -(p * np.log(np.maximum(p, 1e-30))).sum(axis=1))
    return np.clip(1.0 - entropy / np.log(S), 1e-6, 1.0)


def softmap(maps: BlockMaps, *, rounds: int = 2) -> tuple[BlockMaps, CycleReport]:
    """Denoise affinities in [0, 1] by cycle consistency; returns row-stochastic maps.

    `rounds` >= 1 compositions, each composition weighted by the information of both maps
    (`row_information`). Works in float32: the maps are estimates of two digits at best and the
    products are the whole cost.
    """
    if rounds < 1:
        raise ValueError(f"rounds: expected at least 1, got {rounds}")
    every = list(maps.pairs)
    maps = BlockMaps(maps.blocks, {pair: row_stochastic(maps.pairs[pair]) for pair in every})
    change = []
    for _ in range(rounds):
        weighted = {
            pair: m.scaled(row_information(m).astype(np.float32)) for pair, m in maps.pairs.items()
        }
        new, moved, size = {}, 0.0, float(maps.blocks.total)
        for pair in every:
            new[pair], squares = _compared(_composed(weighted, *pair), maps.pairs[pair])
            moved, size = moved + squares[0], size + squares[1]
        maps = BlockMaps(maps.blocks, new)
        change.append(float(np.sqrt(moved / size)))
    status = (
        f"softmap: {rounds} compositions, the last changed the maps by {100 * change[-1]:.1f} %"
    )
    return maps, CycleReport("softmap", True, tuple(change), status)


def _composed(weighted: dict[tuple[int, int], BandedMap], i: int, j: int) -> np.ndarray:
    """Sum (T_i, T_j) over all videos k that both are compared with of P_ik P_kj, i and j themselves
    included."""
    total: np.ndarray = 2 * weighted[i, j].dense()
    for k in {a for a, _ in weighted} - {i, j}:
        if (i, k) not in weighted or (k, j) not in weighted:
            continue
        second = weighted[k, j]
        whole = second.dense()
        for rows, columns, values in weighted[i, k]:
            reached = [
                c for r, c in second.bands if r.start < columns.stop and columns.start < r.stop
            ]
            if reached:
                to = slice(min(c.start for c in reached), max(c.stop for c in reached))
                total[rows, to] += values @ whole[columns, to]
    return total


def _compared(total: np.ndarray, before: BandedMap) -> tuple[BandedMap, tuple[float, float]]:
    """The new map; squared norms of its difference from the one before, and of that."""
    new = row_stochastic(BandedMap.of(total))
    old = before.dense()
    size = float(np.linalg.norm(old)) ** 2
    old -= new.dense()
    return new, (float(np.linalg.norm(old)) ** 2, size)


def row_contrast(
    maps: Float[np.ndarray, "N_a N_a"], blocks: Blocks
) -> Float[np.ndarray, "N_a N_a"]:
    """Scale every block's rows from 0, the row's median or less, to 1, its largest entry.

    A row without any contrast becomes 0 (no information). Blocks within a video are the identity.
    Sparse soft maps, whose median is 0, are only scaled.
    """
    out = np.zeros_like(maps)
    for i in range(len(blocks.lengths)):
        for j in range(len(blocks.lengths)):
            if i != j:
                block = blocks.block(maps, i, j)
                usual = np.median(block, axis=1, keepdims=True)
                room = block.max(axis=1, keepdims=True) - usual
                risen = np.maximum(block - usual, 0.0)
                blocks.block(out, i, j)[...] = risen / np.where(room > 1e-12, room, np.inf)
    blocks.set_diagonal_to_identity(out)
    return out


def symmetric_affinity(
    maps: Float[np.ndarray, "N_a N_a"], blocks: Blocks
) -> Float[np.ndarray, "N_a N_a"]:
    """One symmetric affinity in [0, 1] of directed soft maps: their row contrasts, both directions
    averaged."""
    contrast = row_contrast(maps, blocks)
    return np.asarray(0.5 * (contrast + contrast.T))


FIRST_PENALTY = 64.0


def project(matrix: Float[np.ndarray, "N_a N_a"], blocks: Blocks) -> Float[np.ndarray, "N_a N_a"]:
    """The nearest matrix of C."""
    out = 0.5 * (matrix + matrix.T)
    np.clip(out, 0.0, 1.0, out=out)
    blocks.set_diagonal_to_identity(out)
    return out


def balanced_penalty(mu: float, primal: float, dual: float) -> float:
    """Penalty that keeps the two residuals within a factor of ten of each other (Boyd et al. 2011,
    section 3.4.1)."""
    if primal > 10.0 * dual:
        return 2.0 * mu
    return 0.5 * mu if dual > 10.0 * primal else mu


START_SCALE = 10.0  # about the root of how many frames of all videos resemble one


def _ridge(factor: np.ndarray, target: np.ndarray, ridge: float) -> np.ndarray:
    """argmin_B |target - factor B'|^2 + ridge |B|^2."""
    gram = factor.T @ factor
    gram[np.diag_indices_from(gram)] += ridge
    right = (target.T @ factor).T  # in LAPACK's memory order, so that nothing is copied
    solution: np.ndarray = cho_solve(
        cho_factor(gram, overwrite_a=True, check_finite=False),
        right,
        overwrite_b=True,
        check_finite=False,
    )
    return solution.T


def als(
    affinity: Float[np.ndarray, "N_a N_a"],
    blocks: Blocks,
    *,
    rng: np.random.Generator,
    sparsity: float = 0.1,
    nuclear_weight: float = 50.0,
    rank_factor: float = 2.0,
    tolerance: float = 1e-3,
    max_iterations: int = 50,
) -> tuple[Float[np.ndarray, "N_a N_a"], CycleReport]:
    """Denoise an affinity in [0, 1]; returns X, entries in [0, 1], also when not converged (the
    report says so).

    Args:
        rng: draws the starting factor.
        sparsity: alpha.
        nuclear_weight: lambda.
        rank_factor: times the longest clip bounds the rank; below 2 is too small when the clips
            don't show the same frames.
        tolerance: bound of both residuals divided by N_a.

    Raises:
        ValueError: rank_factor is not positive.
    """
    if rank_factor <= 0:
        raise ValueError(f"rank_factor: expected a positive number, got {rank_factor}")
    N = blocks.total
    rank = int(min(N, np.ceil(rank_factor * max(blocks.lengths))))
    Z = project(affinity.astype(np.float32), blocks)
    reward = Z - np.float32(sparsity)
    Y = np.zeros_like(Z)
    # random combinations of Z's columns: nearer to the solution's range than random numbers are
    A = Z @ (rng.standard_normal((N, rank), dtype=np.float32) / np.float32(START_SCALE))
    mu = FIRST_PENALTY
    history: list[float] = []
    for _ in range(max_iterations):
        target = Z + (reward - Y) / np.float32(mu)
        B = _ridge(A, target, nuclear_weight / mu)
        A = _ridge(B, target.T, nuclear_weight / mu)
        X = A @ B.T
        Z_old, Z = Z, project(X + Y / np.float32(mu), blocks)
        X -= Z
        primal, dual = float(np.linalg.norm(X)) / N, mu * float(np.linalg.norm(Z - Z_old)) / N
        X *= np.float32(mu)
        Y += X
        history.append(max(primal, dual))
        if history[-1] < tolerance:
            break
        mu = balanced_penalty(mu, primal, dual)
    return Z, convergence_report("als", history, tolerance, detail=f", rank bound {rank}")


def shrink_spectrum(matrix: Float[np.ndarray, "N N"], threshold: float) -> Float[np.ndarray, "N N"]:
    """The proximal map of threshold * nuclear norm at a symmetric matrix."""
    values, vectors = eigh(matrix, check_finite=False, overwrite_a=True, driver="evd")
    above = np.abs(values) > threshold
    shrunk = np.sign(values[above]) * (np.abs(values[above]) - threshold)
    return (vectors[:, above] * shrunk.astype(matrix.dtype)) @ vectors[:, above].T


def svt(
    affinity: Float[np.ndarray, "N_a N_a"],
    blocks: Blocks,
    *,
    sparsity: float = 0.1,
    nuclear_weight: float = 50.0,
    tolerance: float = 1e-3,
    max_iterations: int = 50,
) -> tuple[Float[np.ndarray, "N_a N_a"], CycleReport]:
    """Denoise an affinity in [0, 1]; returns X, entries in [0, 1].

    Parameters as in `als`. Exact but slow: one eigenproblem of size N_a per iteration.
    """
    N = blocks.total
    X = project(affinity.astype(np.float32), blocks)
    reward = X - np.float32(sparsity)
    Y = np.zeros_like(X)
    mu = FIRST_PENALTY
    history: list[float] = []
    for _ in range(max_iterations):
        Q = shrink_spectrum(X + Y / np.float32(mu), nuclear_weight / mu)
        X_old, X = X, project(Q + (reward - Y) / np.float32(mu), blocks)
        Y += np.float32(mu) * (X - Q)
        primal, dual = float(np.linalg.norm(X - Q)) / N, mu * float(np.linalg.norm(X - X_old)) / N
        history.append(max(primal, dual))
        if history[-1] < tolerance:
            break
        mu = balanced_penalty(mu, primal, dual)
    return X, convergence_report("svt", history, tolerance)


def relax(
    method: CycleMethod, maps: BlockMaps, *, rounds: int, rng: np.random.Generator
) -> tuple[BlockMaps, CycleReport]:
    """Denoise soft maps or affinities; fewer than three videos have no cycle and stay as they are.

    `rounds` compositions of `softmap`; `rng` draws the starting factor of `als`.
    """
    if method == "none" or len(maps.blocks.lengths) < 3:
        why = "switched off" if method == "none" else "fewer than three videos, no cycle"
        return maps, CycleReport("none", True, (), f"none: {why}")
    if method == "softmap":
        return softmap(maps, rounds=rounds)
    affinity = symmetric_affinity(maps.dense(), maps.blocks)
    if method == "als":
        relaxed, report = als(affinity, maps.blocks, rng=rng)
    else:
        relaxed, report = svt(affinity, maps.blocks)
    return BlockMaps.of(relaxed, maps.blocks), report
