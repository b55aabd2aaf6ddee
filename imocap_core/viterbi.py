"""The cheapest sequence of a few states (Viterbi, IEEE Trans. Inf. Theory 13:260-269, 1967)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int


def cheapest_states(
    first: Float[np.ndarray, " S"], steps: Float[np.ndarray, "T S S"]
) -> Int[np.ndarray, " _"]:
    """States (T + 1,) of least total cost.

    Args:
        first: cost of each state in the first frame.
        steps: of frame t + 1 in the second state after frame t in the first.
    """
    total, back = first, []
    for step in steps:
        costs = total[:, None] + step
        back.append(costs.argmin(0))
        total = costs.min(0)
    states = [int(total.argmin())]
    for pointer in reversed(back):
        states.append(int(pointer[states[-1]]))
    return np.array(states[::-1])
