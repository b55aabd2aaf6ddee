"""What the two forward-backward passes share: bounded likelihoods, normalised posteriors."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

# a frame's worst position is at most this much less likely than its best one, in nats
WORST_FRAME = 25.0


def bounded_likelihoods(
    cost: Float[np.ndarray, "N S"], unmatched: float | Float[np.ndarray, " N"]
) -> tuple[Float[np.ndarray, "N S"], Float[np.ndarray, " N"], Float[np.ndarray, " N"]]:
    """Likelihoods of the match and of no match, and the cost (N,) that is divided out of both.

    No frame may rule a position out altogether: one bad pose would end every warp there.
    """
    base = np.minimum(cost.min(axis=1), unmatched)
    match = np.exp(np.maximum(base[:, None] - cost, -WORST_FRAME))
    skip = np.exp(np.maximum(base - unmatched, -WORST_FRAME))
    return match, skip, base


def normalised(
    joint: Float[np.ndarray, "N S"], outside: Float[np.ndarray, " N"]
) -> tuple[Float[np.ndarray, "N S"], Float[np.ndarray, " N"]]:
    """P(position | matched) and P(matched) of each frame, from the joint weights of its positions
    and of having no counterpart."""
    inside = joint.sum(axis=1)
    total = inside + outside
    posterior = joint / np.where(inside > 0, inside, 1.0)[:, None]
    posterior[~(inside > 0)] = 1.0 / joint.shape[1]
    matched = np.divide(inside, total, out=np.zeros(len(inside)), where=total > 0)
    return posterior, matched
