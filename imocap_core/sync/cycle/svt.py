"""Cycle consistency by singular-value thresholding (Dong et al., CVPR 2019; Cai, Candes, Shen
2010).

Eq. 2 (see `admm`) with the nuclear norm itself: the low-rank step shrinks the singular values.
X + Y / mu is symmetric, so they are the moduli of its eigenvalues: one symmetric eigenproblem an
iteration instead of a singular-value decomposition.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.linalg import eigh

from imocap_core.sync.blocks import Blocks
from imocap_core.sync.cycle.admm import FIRST_PENALTY, balanced_penalty, project
from imocap_core.sync.cycle.report import CycleReport, convergence_report


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
