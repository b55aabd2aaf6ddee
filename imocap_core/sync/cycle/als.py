"""Cycle consistency by low-rank factors: MatchALS (Zhou, Zhu, Daniilidis, ICCV 2015).

Eq. 2 (see `admm`) with the nuclear norm written as ridge penalties on two factors:

    min  -<S - alpha, X> + lambda/2 (|A|^2 + |B|^2)   subject to  X = A B',  X in C.

The constraint is split (Z in C, multiplier Y, penalty mu); every step is a ridge solve or a clip,
so an iteration costs three thin matrix products.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.linalg import cho_factor, cho_solve

from imocap_core.sync.blocks import Blocks
from imocap_core.sync.cycle.admm import FIRST_PENALTY, balanced_penalty, project
from imocap_core.sync.cycle.report import CycleReport, convergence_report

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
