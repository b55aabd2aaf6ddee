"""Selected inversion: the diagonal blocks of the inverse of a block-pentadiagonal matrix.

With ``H = W^T D W``, W unit upper and as banded as H, the inverse's blocks follow from the last
frame to the first (Takahashi et al., 1973): given the two frames after it, frame t is
``-U_t [x_{t+1}; x_{t+2}]`` plus an independent part of covariance ``D_t^-1``. Time and memory are
linear in the number of frames; the dense inverse is never formed.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

FLOOR = 1e-12  # of a block's largest diagonal entry, so that unobserved unknowns stay finite


@dataclass(frozen=True)
class Factored:
    """``H = W^T D W`` of a symmetric positive definite block-pentadiagonal H (T frames, n each).

    Attributes:
        factors: T lower Cholesky factors (n, n) of D's blocks.
        after: T blocks U_t (n, 2n): W's entries at the two frames after t; 0 beyond the last.
        ok: False where H was not positive definite; every result is NaN then.
    """

    factors: list[Float[Tensor, "n n"]]
    after: list[Float[Tensor, "n 2*n"]]
    ok: bool

    def solve(self, right: Float[Tensor, "T n k"]) -> Float[Tensor, "T n k"]:
        """Solution of ``H x = right``."""
        n, solution = right.shape[1], torch.empty_like(right)
        for t in range(len(right)):
            value = right[t]
            if t >= 1:
                value = value - self.after[t - 1][:, :n].T @ solution[t - 1]
            if t >= 2:
                value = value - self.after[t - 2][:, n:].T @ solution[t - 2]
            solution[t] = value
        later = right.new_zeros(2 * n, right.shape[2])
        for t in reversed(range(len(right))):
            value = torch.cholesky_solve(solution[t], self.factors[t]) - self.after[t] @ later
            later = torch.cat([value, later[:n]])
            solution[t] = value
        return self._checked(solution)

    def inverse_diagonal(self) -> Float[Tensor, "T n n"]:
        """Blocks (t, t) of ``H^-1``."""
        n = len(self.factors[0])
        later = self.factors[0].new_zeros(2 * n, 2 * n)  # inverse at the two frames after t
        blocks = self.factors[0].new_empty(len(self.factors), n, n)
        for t in reversed(range(len(blocks))):
            factor, after = self.factors[t], self.after[t]
            cross = -after @ later
            block = torch.cholesky_inverse(factor) - cross @ after.T
            block = (block + block.T) / 2
            blocks[t] = block
            later = torch.cat(
                [
                    torch.cat([block, cross[:, :n]], 1),
                    torch.cat([cross[:, :n].T, later[:n, :n]], 1),
                ]
            )
        return self._checked(blocks)

    def _checked(self, value: Tensor) -> Tensor:
        return value if self.ok else torch.full_like(value, torch.nan)


def factorise(
    diagonal: Float[Tensor, "T n n"], next1: Float[Tensor, "..."], next2: Float[Tensor, "..."]
) -> Factored:
    """Factor a block-pentadiagonal matrix.

    Args:
        diagonal, next1, next2: blocks (t, t), (t, t+1), (t, t+2), of equal shape; the last one of
            ``next1`` and the last two of ``next2`` are ignored.

    Raises:
        ValueError: the three have different or no block shapes.
    """
    if not diagonal.shape == next1.shape == next2.shape or diagonal.ndim != 3:
        got = [tuple(x.shape) for x in (diagonal, next1, next2)]
        raise ValueError(f"diagonal, next1 and next2 must be three arrays (T, n, n), got {got}")
    frames, n = diagonal.shape[:2]
    factors: list[Tensor] = []
    after: list[Tensor] = []
    ok = True
    blocks, beside = map(_floored, diagonal), map(torch.clone, next1)
    block, near, near_next = next(blocks), next(blocks, None), next(beside)
    for t in range(frames):
        far, far_next = next(blocks, None), next(beside, None)
        factor, info = torch.linalg.cholesky_ex(block)
        ok &= int(info) == 0
        coupled = torch.cat([near_next, next2[t]], 1)
        if t + 1 >= frames:
            coupled = torch.zeros_like(coupled)
        elif t + 2 >= frames:
            coupled[:, n:] = 0.0
        reach = torch.cholesky_solve(coupled, factor)
        factors.append(factor)
        after.append(reach)
        lost = coupled.T @ reach
        if far is not None:
            far -= lost[n:, n:]
        if near is not None and far_next is not None:
            near -= lost[:n, :n]
            far_next -= lost[:n, n:]
            block, near, near_next = near, far, far_next
    return Factored(factors, after, ok)


def _floored(block: Float[Tensor, "n n"]) -> Float[Tensor, "n n"]:
    """A copy with the floor on its diagonal."""
    copy = block.clone()
    entries = copy.diagonal()
    entries.add_(FLOOR * entries.amax() + FLOOR)
    return copy
