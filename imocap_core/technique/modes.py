"""Modes of variation: principal components of the performances' deviations from their mean.

The low-rank model of Eq. 4 with the mean removed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from imocap_core.rotations import exp

ROUND_OFF = 1e-9  # singular values below this share of the largest are round-off


@dataclass(frozen=True, eq=False)
class Modes:
    """K modes of variation, the strongest first.

    Performance m is the mean motion turned by ``sum_k scores[m, k] * shapes[k]``.

    Attributes:
        share: of the performances' summed squared deviation; they sum to 1.
        scores: degrees, root mean square over all joints and moments; they sum to 0 over the
            performances.
        shapes: rotation vectors per degree of score; their mean square over joints and moments is
            1 degree.
    """

    share: Float[np.ndarray, " K"]
    scores: Float[np.ndarray, "M K"]
    shapes: Float[np.ndarray, "K N J 3"]

    def of_joints(self) -> Float[np.ndarray, "K J"]:
        """Size of each mode in each joint at one standard deviation, degrees, root mean square
        over the moments."""
        size = np.sqrt((self.shapes**2).sum(-1).mean(1))
        return np.rad2deg(size) * self.deviations()[:, None]

    def deviations(self) -> Float[np.ndarray, " K"]:
        """Standard deviation of the scores, degrees."""
        return np.sqrt((self.scores**2).sum(0) / max(len(self.scores) - 1, 1))


def modes(turns: Float[np.ndarray, "M N J 3"]) -> Modes:
    """Principal components over the performances of their deviations, radians; at most M - 1.

    Moments that a performance does not show are 0, like the mean.
    """
    M, N, J, _ = turns.shape
    rows = turns.reshape(M, -1)
    rows = rows - rows.mean(0)
    U, sigma, Vh = np.linalg.svd(rows, full_matrices=False)
    chosen = np.flatnonzero(sigma > ROUND_OFF * max(float(sigma.max(initial=0.0)), 1e-12))[: M - 1]
    size = np.sqrt(N * J)
    scores = np.rad2deg(U[:, chosen] * sigma[chosen] / size)
    shapes = np.deg2rad(Vh[chosen].reshape(-1, N, J, 3) * size)
    for k in range(len(chosen)):  # the sign is free: the largest score is positive
        if scores[np.abs(scores[:, k]).argmax(), k] < 0:
            scores[:, k], shapes[k] = -scores[:, k], -shapes[k]
    squares = sigma[chosen] ** 2
    return Modes(squares / max(float(squares.sum()), 1e-300), scores, shapes)


def along_mode(
    R_local: Float[np.ndarray, "N J 3 3"], shape: Float[np.ndarray, "N J 3"], amount_deg: float
) -> Float[np.ndarray, "N J 3 3"]:
    """The mean motion displaced along a mode's shape."""
    return np.asarray(R_local @ exp(torch.as_tensor(amount_deg * shape)).numpy())
