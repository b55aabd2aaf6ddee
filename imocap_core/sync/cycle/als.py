"""Cycle consistency by a low-rank factorisation: MatchALS (Zhou, Zhu, Daniilidis, ICCV 2015).

Eq. 2 with the rank relaxed to the nuclear norm, and the nuclear norm written as ridge penalties on
two factors:

    min  -<S - alpha, X> + lambda/2 (|A|^2 + |B|^2)   subject to  X = A B',  X in C,

C: symmetric, entries in [0, 1], a video's own block the identity. The constraint is split (Z in C,
multiplier Y, penalty mu); every step is a ridge solve or a clip, so an iteration costs three thin
matrix products.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from imocap_core.sync.blocks import Blocks
from imocap_core.sync.cycle.report import CycleReport, outcome_of

Matrix = NDArray[np.floating]


START_SCALE = 10.0  # about the root of how many frames of all videos resemble one


def project(matrix: Matrix, blocks: Blocks) -> Matrix:
    """The nearest matrix of C: symmetric, own blocks the identity, entries in [0, 1]."""
    out = 0.5 * (matrix + matrix.T)
    np.clip(out, 0.0, 1.0, out=out)
    blocks.set_diagonal_to_identity(out)
    return out


def balanced_penalty(mu: float, primal: float, dual: float) -> float:
    """Keep the two residuals within a factor of ten of each other (Boyd et al. 2011, section
    3.4.1)."""
    if primal > 10.0 * dual:
        return 2.0 * mu
    return 0.5 * mu if dual > 10.0 * primal else mu


def _ridge(factor: Matrix, target: Matrix, ridge: float) -> Matrix:
    """argmin_B |target - factor B'|^2 + ridge |B|^2."""
    gram = factor.T @ factor
    gram[np.diag_indices_from(gram)] += ridge
    right = (target.T @ factor).T  # as LAPACK has it, so that nothing is copied
    solution: Matrix = cho_solve(
        cho_factor(gram, overwrite_a=True, check_finite=False),
        right,
        overwrite_b=True,
        check_finite=False,
    )
    return solution.T


def als(
    affinity: Matrix,
    blocks: Blocks,
    *,
    rng: np.random.Generator,
    sparsity: float = 0.1,
    nuclear_weight: float = 50.0,
    rank_factor: float = 2.0,
    tolerance: float = 1e-3,
    max_iterations: int = 50,
) -> tuple[Matrix, CycleReport]:
    """Denoise an affinity (N_a, N_a) in [0, 1]; returns X of the same shape, entries in [0, 1].

    `rank_factor` times the longest clip bounds the rank: below 2 is too small when the clips don't
    show the same frames. `sparsity` is alpha, `nuclear_weight` lambda, `tolerance` bounds both
    residuals divided by N_a; `rng` draws the starting factor. The answer of an unconverged run is
    still usable and the report says so.
    """
    if rank_factor <= 0:
        raise ValueError(f"rank_factor: expected a positive number, got {rank_factor}")
    N = blocks.total
    rank = int(min(N, np.ceil(rank_factor * max(blocks.lengths))))
    Z = project(affinity.astype(np.float32), blocks)
    reward = Z - np.float32(sparsity)
    Y = np.zeros_like(Z)
    # random combinations of Z's columns: nearer to the answer's range than random numbers are
    A = Z @ (rng.standard_normal((N, rank), dtype=np.float32) / np.float32(START_SCALE))
    mu = 64.0
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
    converged = history[-1] < tolerance
    status = f"als: {outcome_of(history, tolerance)}, rank bound {rank}"
    return Z, CycleReport("als", converged, tuple(history), status)
