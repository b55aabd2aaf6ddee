"""Block Cholesky solution of a block-pentadiagonal system, from both ends at once.

Frames couple to their two successors at most. Eliminating them from the first and from the last
towards two frames in the middle takes as many operations as from one end, but the two halves can
be worked on at the same time; at the middle they meet in one small dense system.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.workers import Each, in_turn

MIDDLE = 2  # frames between the halves: as many as a frame couples to


@dataclass(frozen=True)
class Half:
    """Eliminated frames, the outermost first.

    Attributes:
        factors: each frame's Cholesky factor L (n, n).
        solved: each frame's ``L^-1 [next1 | next2 | right]``, transposed: (2n + k, n).
        middle: (MIDDLE, 3n + k, n) columns of the next frames, after elimination.
        failed: () nonzero where the matrix is not positive definite.
    """

    factors: list[Tensor]
    solved: list[Tensor]
    middle: Tensor
    failed: Tensor


def solve_pentadiagonal(
    diagonal: Float[Tensor, "T n n"],
    next1: Float[Tensor, "T n n"],
    next2: Float[Tensor, "T n n"],
    right: Float[Tensor, "T n k"],
    each: Each = in_turn,
) -> Float[Tensor, "T n k"]:
    """Solve a symmetric positive definite block-pentadiagonal system.

    Args:
        diagonal, next1, next2: blocks (t, t), (t, t+1), (t, t+2); the last one of ``next1`` and
            the last two of ``next2`` are ignored.
        each: runs the two halves.

    Returns:
        The solution, NaN where the matrix is not positive definite (the caller damps and
        retries).
    """
    frames = len(diagonal)
    if frames < MIDDLE:
        factor, info = torch.linalg.cholesky_ex(diagonal)
        return torch.where(info != 0, torch.nan, torch.cholesky_solve(right, factor))
    first = (frames - MIDDLE) // 2
    halves = each(
        _eliminated,
        [
            _from_first(diagonal, next1, next2, right, first),
            _from_last(diagonal, next1, next2, right, first),
        ],
    )
    middle, info = _middle(halves[0].middle, halves[1].middle)
    ends = each(_substituted, [(halves[0], middle), (halves[1], middle.flip(0))])
    solution = torch.cat([ends[0], middle, ends[1].flip(0)]).mT
    failed = halves[0].failed | halves[1].failed | info
    return torch.where(failed != 0, torch.nan, solution)


def _from_first(
    diagonal: Tensor, next1: Tensor, next2: Tensor, right: Tensor, first: int
) -> Tensor:
    """(first + MIDDLE, 3n + k, n) columns [diagonal; next1^T; next2^T; right^T] of each frame.

    Contiguous for a library of column-major routines, and so is each frame's update.
    """
    half = slice(0, first + MIDDLE)
    return torch.cat([diagonal[half], next1[half].mT, next2[half].mT, right[half].mT], 1)


def _from_last(diagonal: Tensor, next1: Tensor, next2: Tensor, right: Tensor, first: int) -> Tensor:
    """The same from the last frame backwards; the middle's own values are in the other half."""
    n, last = diagonal.shape[1], len(diagonal) - first - MIDDLE
    columns = diagonal.new_zeros(last + MIDDLE, 3 * n + right.shape[2], n)
    half = slice(first + MIDDLE, None)
    columns[:last, :n] = diagonal[half].flip(0)
    columns[:last, n : 2 * n] = next1[first + 1 : -1].flip(0)
    columns[:last, 2 * n : 3 * n] = next2[first:-2].flip(0)
    columns[:last, 3 * n :] = right[half].flip(0).mT
    return columns


def _eliminated(columns: Tensor) -> Half:
    """All frames but the last two. A frame's factor L gives A = L^-1 [next1 | next2 | right]; the
    products of A's columns are subtracted from the two frames after it."""
    n = columns.shape[2]
    info, factors, eliminated = [], [], []
    frames = columns.unbind()
    for t in range(len(frames) - MIDDLE):
        frame, after, last = frames[t : t + 1 + MIDDLE]
        factor, failed = torch.linalg.cholesky_ex(frame[:n])
        solved = torch.linalg.solve_triangular(factor, frame[n:].T, upper=False).T
        one, two, right = solved.split((n, n, len(solved) - 2 * n))
        after[: 2 * n].addmm_(solved[: 2 * n], one.T, alpha=-1)
        after[3 * n :].addmm_(right, one.T, alpha=-1)
        last[:n].addmm_(two, two.T, alpha=-1)
        last[3 * n :].addmm_(right, two.T, alpha=-1)
        info.append(failed)
        factors.append(factor)
        eliminated.append(solved)
    failed = torch.stack(info).amax() if info else columns.new_zeros((), dtype=torch.int32)
    return Half(factors, eliminated, columns[-MIDDLE:].clone(), failed)


def _middle(from_first: Tensor, from_last: Tensor) -> tuple[Tensor, Tensor]:
    """(MIDDLE, k, n) solution where the halves meet, and whether the factorisation failed."""
    n = from_first.shape[2]
    near, far = from_first + from_last.flip(0)
    cross = from_first[0, n : 2 * n] + from_last[0, n : 2 * n].T  # the far frame by the near one
    whole = torch.cat([torch.cat([near[:n], cross.T], 1), torch.cat([cross, far[:n]], 1)])
    factor, info = torch.linalg.cholesky_ex(whole)
    right = torch.cat([near[3 * n :], far[3 * n :]], 1)
    solution = torch.cholesky_solve(right.T, factor)
    return solution.unflatten(0, (MIDDLE, n)).mT, info


def _substituted(work: tuple[Half, Tensor]) -> Tensor:
    """(frames of the half, k, n) solution, given the middle's in the half's order."""
    half, middle = work
    (_, k, n), count = middle.shape, len(half.factors)
    near, far = middle.unbind()
    solution = []
    for factor, solved in zip(half.factors[::-1], half.solved[::-1], strict=True):
        later = torch.cat([near, far], 1)
        value = torch.addmm(solved[2 * n :], later, solved[: 2 * n], alpha=-1)
        near, far = torch.linalg.solve_triangular(factor.T, value.T, upper=True).T, near
        solution.append(near)
    return torch.stack(solution[::-1]) if solution else middle.new_empty(count, k, n)
