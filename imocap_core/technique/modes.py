"""The few ways in which performances differ: low-rank modes of their deviations (Eq. 4's model,
with the mean taken out)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from imocap_core.rotations import exp

Array = NDArray[np.float64]

NOTHING = 1e-9  # singular values below this share of the largest are round-off


@dataclass(frozen=True, eq=False)
class Modes:
    """K ways to differ, the strongest first; performance m is the mean turned by
    ``sum_k scores[m, k] * shapes[k]``.

    Attributes:
        share (K,): of the performances' summed squared deviation. They sum to 1.
        scores (M, K): degrees, root mean square over all joints and moments; they sum to 0.
        shapes (K, N, J, 3): rotation vectors per degree of score; their mean square over joints
            and moments is 1 degree.
    """

    share: Array
    scores: Array
    shapes: Array

    def of_joints(self) -> Array:
        """(K, J) degrees, root mean square over the moments at one standard deviation."""
        own = np.sqrt((self.shapes**2).sum(-1).mean(1))
        return np.rad2deg(own) * self.deviations()[:, None]

    def deviations(self) -> Array:
        """(K,) standard deviation of the scores, degrees."""
        return np.sqrt((self.scores**2).sum(0) / max(len(self.scores) - 1, 1))


def modes(turns: Array) -> Modes:
    """Principal components over the performances of deviations (M, N, J, 3), radians; at most
    M - 1. Moments that a performance does not show are 0: as the mean does them."""
    M, N, J, _ = turns.shape
    rows = turns.reshape(M, -1)
    rows = rows - rows.mean(0)
    U, sigma, Vh = np.linalg.svd(rows, full_matrices=False)
    kept = np.flatnonzero(sigma > NOTHING * max(float(sigma.max(initial=0.0)), 1e-12))[: M - 1]
    size = np.sqrt(N * J)
    scores = np.rad2deg(U[:, kept] * sigma[kept] / size)
    shapes = np.deg2rad(Vh[kept].reshape(-1, N, J, 3) * size)
    for k in range(len(kept)):  # the sign is free: the largest score is positive
        if scores[np.abs(scores[:, k]).argmax(), k] < 0:
            scores[:, k], shapes[k] = -scores[:, k], -shapes[k]
    squares = sigma[kept] ** 2
    return Modes(squares / max(float(squares.sum()), 1e-300), scores, shapes)


def along_mode(R_local: Array, shape: Array, amount_deg: float) -> Array:
    """The mean motion (N, J, 3, 3) turned along a mode's shape (N, J, 3)."""
    return np.asarray(R_local @ exp(torch.as_tensor(amount_deg * shape)).numpy())
