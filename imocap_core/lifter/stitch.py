"""One alternative motion from the hypotheses of overlapping windows (Viterbi).

The hypotheses of a window have no particular order. The cheapest path selects one of each window so
that overlapping windows agree and the motion differs from the mean output.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

DIFFERENCE = 0.5  # weight of the distance from the mean output, relative to that in an overlap


def stitch_alternatives(
    joints: Float[Tensor, "B L 24 3"], alternatives: Float[Tensor, "B L H 24 3"], hop: int
) -> Float[Tensor, "B L 24 3"]:
    """One alternative of each window, consistent from window to window.

    Args:
        joints: mean outputs. alternatives: hypotheses. hop: frames between consecutive windows.
    """
    distance = (alternatives - joints[:, :, None]).norm(dim=-1).mean((1, 3))
    unary = -DIFFERENCE * distance
    total, back = unary[0], []
    for before, after, cost in zip(alternatives[:-1], alternatives[1:], unary[1:], strict=True):
        a, b = before[hop:], after[: len(after) - hop]
        step = (a[:, :, None] - b[:, None]).norm(dim=-1).mean((0, 3))
        best = (total[:, None] + step).min(0)
        total = best.values + cost
        back.append(best.indices)
    chosen = [int(total.argmin())]
    for pointer in reversed(back):
        chosen.append(int(pointer[chosen[-1]]))
    picked = torch.tensor(chosen[::-1], device=joints.device)
    return alternatives[torch.arange(len(picked), device=joints.device), :, picked]
