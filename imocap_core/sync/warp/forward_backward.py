"""What the two forward-backward passes share: bounded likelihoods, normalised posteriors."""

from __future__ import annotations

from collections.abc import Callable

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


def moved(
    state: np.ndarray, here: slice, there: slice, step: Callable[[np.ndarray], np.ndarray]
) -> np.ndarray:
    """A step of the chain from the positions `here` (..., S_here) to the positions `there`, of
    which those that the state does not have are 0."""
    if here == there:
        return step(state)
    first, stop = min(here.start, there.start), max(here.stop, there.stop)
    wide = np.zeros((*state.shape[:-1], stop - first))
    wide[..., here.start - first : here.stop - first] = state
    return step(wide)[..., there.start - first : there.stop - first]
