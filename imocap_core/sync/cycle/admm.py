"""Steps that the two ADMM solvers of Eq. 2 share: projection, penalty, residuals.

The problem: Eq. 2 with the rank relaxed to the nuclear norm,

    min  -<S - alpha, X> + lambda |X|_*   subject to  X in C,

C: symmetric, entries in [0, 1], the blocks within a video the identity.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from imocap_core.sync.blocks import Blocks

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
