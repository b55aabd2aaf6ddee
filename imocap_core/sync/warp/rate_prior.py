"""Prior of a performance's rate: a Markov chain on a grid of rates around the usual one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

RATE_GRID = 0.17  # between neighbouring rates, in log units
JUMPS_PER_S = 0.2  # a rate changes to any other about this often


@dataclass(frozen=True)
class RatePrior:
    """Markov chain of K rates.

    Attributes:
        advance: positions per frame, rising.
        share: of the time a priori, summing to 1; the stationary distribution of `moves`.
        moves: P(next rate | rate), rows summing to 1.
    """

    advance: Float[np.ndarray, " K"]
    share: Float[np.ndarray, " K"]
    moves: Float[np.ndarray, "K K"]


def rate_prior(
    *, usual: float, spread: float, persistence_s: float, max_rate: float, fps: float
) -> RatePrior:
    """Rates around `usual` positions per frame, from 1 / `max_rate` to `max_rate` times it.

    Args:
        spread: standard deviation of the logarithm of a rate.
        persistence_s: time over which a rate persists.
        fps: of the video whose frames advance.

    Raises:
        ValueError: a number is out of range.
    """
    if not (usual > 0 and spread > 0 and persistence_s > 0 and max_rate >= 1 and fps > 0):
        raise ValueError(
            "usual, spread, persistence_s, fps: expected > 0 and max_rate >= 1, got "
            f"{usual}, {spread}, {persistence_s}, {fps}, {max_rate}"
        )
    reach = min(np.log(max_rate), 4.0 * spread)
    side = max(1, int(np.ceil(reach / RATE_GRID)))
    log_rate = np.arange(-side, side + 1) * (reach / side)
    share = np.exp(-0.5 * (log_rate / spread) ** 2)
    share /= share.sum()
    # a walk to the neighbours that moves log rates as fast as their spread and persistence demand
    drift = spread**2 / (persistence_s * fps) / max(reach / side, 1e-9) ** 2
    K = len(share)
    jump = min(JUMPS_PER_S / fps, 0.5)
    moves = np.zeros((K, K))
    for k in range(K):
        for other in (k - 1, k + 1):
            if 0 <= other < K:
                moves[k, other] = min(drift, 0.4) * min(1.0, share[other] / share[k])
    moves[np.diag_indices(K)] = 1.0 - moves.sum(axis=1)
    moves = (1.0 - jump) * moves + jump * share
    return RatePrior(usual * np.exp(log_rate), share, moves)
