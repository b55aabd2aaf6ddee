"""Cycle consistency by singular-value thresholding (Dong et al., CVPR 2019; Cai, Candes, Shen
2010).

The same problem as `als`, with the nuclear norm kept: the low-rank step shrinks the singular
values. X + Y / mu is symmetric, so its eigenvalues do: one symmetric eigenproblem an iteration
instead of a singular-value decomposition.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from imocap_core.sync.blocks import Blocks
from imocap_core.sync.cycle.als import balanced_penalty, project
from imocap_core.sync.cycle.report import CycleReport, outcome_of

Matrix = NDArray[np.floating]


def shrink_spectrum(matrix: Matrix, threshold: float) -> Matrix:
    """The proximal map of threshold * nuclear norm at a symmetric matrix."""
    values, vectors = eigh(matrix, check_finite=False, overwrite_a=True, driver="evd")
    kept = np.abs(values) > threshold
    small = np.sign(values[kept]) * (np.abs(values[kept]) - threshold)
    return (vectors[:, kept] * small.astype(matrix.dtype)) @ vectors[:, kept].T


def svt(
    affinity: Matrix,
    blocks: Blocks,
    *,
    sparsity: float = 0.1,
    nuclear_weight: float = 50.0,
    tolerance: float = 1e-3,
    max_iterations: int = 50,
) -> tuple[Matrix, CycleReport]:
    """Denoise an affinity (N_a, N_a) in [0, 1]; returns X of the same shape, entries in [0, 1].

    Parameters as in `als`. Exact but slow: one eigenproblem of size N_a per iteration.
    """
    N = blocks.total
    X = project(affinity.astype(np.float32), blocks)
    reward = X - np.float32(sparsity)
    Y = np.zeros_like(X)
    mu = 64.0
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
    converged = history[-1] < tolerance
    status = f"svt: {outcome_of(history, tolerance)}"
    return X, CycleReport("svt", converged, tuple(history), status)
