"""One other motion out of what overlapping windows offer.

Each window names alternatives in no particular order. A cheapest path picks one of each so that
overlapping windows agree and the motion differs from the mean answer.
"""

from __future__ import annotations

import torch
from torch import Tensor

DIFFERENCE = 0.5  # what being unlike the mean answer is worth, of the same distance in an overlap


def one_alternative(joints: Tensor, alternatives: Tensor, hop: int) -> Tensor:
    """(B, L, 24, 3) of the mean answers (B, L, 24, 3) and alternatives (B, L, H, 24, 3).

    Windows follow one another by ``hop`` frames.
    """
    away = (alternatives - joints[:, :, None]).norm(dim=-1).mean((1, 3))
    unary = -DIFFERENCE * away
    total, back = unary[0], []
    for before, after, own in zip(alternatives[:-1], alternatives[1:], unary[1:], strict=True):
        a, b = before[hop:], after[: len(after) - hop]
        step = (a[:, :, None] - b[:, None]).norm(dim=-1).mean((0, 3))
        best = (total[:, None] + step).min(0)
        total = best.values + own
        back.append(best.indices)
    chosen = [int(total.argmin())]
    for pointer in reversed(back):
        chosen.append(int(pointer[chosen[-1]]))
    picked = torch.tensor(chosen[::-1])
    return alternatives[torch.arange(len(picked)), :, picked]
