"""Block Cholesky solution of a block-pentadiagonal system, from both ends at once.

Frames couple to their two successors at most. Eliminating them from the first and from the last
towards two frames in the middle takes as many operations as from one end, but the two halves can
be worked on at the same time; at the middle they meet in one small dense system.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from imocap_core.motion.workers import Each, in_turn

MIDDLE = 2  # frames between the halves: as far as a frame reaches


@dataclass(frozen=True)
class Half:
    """Eliminated frames, the outermost first.

    Attributes:
        factors: each frame's Cholesky factor L (n, n).
        known: each frame's L^-1 [next1 | next2 | right] (n, 2n + k).
        middle: (MIDDLE, n, 3n + k) rows of the frames after the last, after their losses.
        failed: () nonzero where the matrix is not positive definite.
    """

    factors: list[Tensor]
    known: list[Tensor]
    middle: Tensor
    failed: Tensor


def solve_pentadiagonal(
    diagonal: Tensor, next1: Tensor, next2: Tensor, right: Tensor, each: Each = in_turn
) -> Tensor:
    """Solve a symmetric positive definite block-pentadiagonal system.

    Args:
        diagonal, next1, next2: (T, n, n) blocks (t, t), (t, t+1), (t, t+2); the last one of
            ``next1`` and the last two of ``next2`` are ignored.
        right: (T, n, k).
        each: does the two halves.

    Returns:
        (T, n, k) solution, NaN where the matrix is not positive definite (the caller damps and
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
            _rows_from_first(diagonal, next1, next2, right, first),
            _rows_from_last(diagonal, next1, next2, right, first),
        ],
    )
    middle, info = _middle(halves[0].middle, halves[1].middle)
    ends = each(_substituted, [(halves[0], middle), (halves[1], middle.flip(0))])
    solution = torch.cat([ends[0], middle, ends[1].flip(0)])
    failed = halves[0].failed | halves[1].failed | info
    return torch.where(failed != 0, torch.nan, solution)


def _rows_from_first(
    diagonal: Tensor, next1: Tensor, next2: Tensor, right: Tensor, first: int
) -> Tensor:
    """(first + MIDDLE, n, 3n + k) rows [diagonal | next1 | next2 | right]."""
    own = slice(0, first + MIDDLE)
    return torch.cat([diagonal[own], next1[own], next2[own], right[own]], -1)


def _rows_from_last(
    diagonal: Tensor, next1: Tensor, next2: Tensor, right: Tensor, first: int
) -> Tensor:
    """The same from the last frame backwards; the middle's own values stand in the other half."""
    n, last = diagonal.shape[1], len(diagonal) - first - MIDDLE
    rows = diagonal.new_zeros(last + MIDDLE, n, 3 * n + right.shape[2])
    own = slice(first + MIDDLE, None)
    rows[:last, :, :n] = diagonal[own].flip(0)
    rows[:last, :, n : 2 * n] = next1[first + 1 : -1].flip(0).transpose(1, 2)
    rows[:last, :, 2 * n : 3 * n] = next2[first:-2].flip(0).transpose(1, 2)
    rows[:last, :, 3 * n :] = right[own].flip(0)
    return rows


def _eliminated(rows: Tensor) -> Half:
    """All rows but the last two. A frame's factor L gives A = L^-1 [next1 | next2 | right]; the
    products of A's columns with themselves are what the two frames after it lose."""
    n = rows.shape[1]
    failed = torch.zeros((), dtype=torch.int32, device=rows.device)
    factors, eliminated = [], []
    row = rows.unbind()
    for t in range(len(row) - MIDDLE):
        factor, info = torch.linalg.cholesky_ex(row[t][:, :n])
        failed |= info
        known = torch.linalg.solve_triangular(factor, row[t][:, n:], upper=False)
        factors.append(factor)
        eliminated.append(known)
        one, two, right = known[:, :n], known[:, n : 2 * n], known[:, 2 * n :]
        row[t + 1][:, : 2 * n].addmm_(one.T, known[:, : 2 * n], alpha=-1)
        row[t + 1][:, 3 * n :].addmm_(one.T, right, alpha=-1)
        row[t + 2][:, :n].addmm_(two.T, two, alpha=-1)
        row[t + 2][:, 3 * n :].addmm_(two.T, right, alpha=-1)
    return Half(factors, eliminated, rows[-MIDDLE:].clone(), failed)


def _middle(from_first: Tensor, from_last: Tensor) -> tuple[Tensor, Tensor]:
    """(MIDDLE, n, k) solution where the halves meet, and whether the factorisation failed."""
    n = from_first.shape[1]
    near, far = from_first + from_last.flip(0)
    cross = from_first[0, :, n : 2 * n] + from_last[0, :, n : 2 * n].T
    whole = torch.cat([torch.cat([near[:, :n], cross], 1), torch.cat([cross.T, far[:, :n]], 1)])
    factor, info = torch.linalg.cholesky_ex(whole)
    right = torch.cat([near[:, 3 * n :], far[:, 3 * n :]])
    return torch.cholesky_solve(right, factor).unflatten(0, (MIDDLE, n)), info


def _substituted(work: tuple[Half, Tensor]) -> Tensor:
    """(frames of the half, n, k) solution, given the middle's in the half's order."""
    half, middle = work
    (_, n, k), count = middle.shape, len(half.factors)
    solution = torch.cat([middle.new_empty(count, n, k), middle])
    flat = solution.flatten(0, 1)
    for t in range(count - 1, -1, -1):
        known, later = half.known[t], flat[(t + 1) * n : (t + 1 + MIDDLE) * n]
        value = torch.addmm(known[:, 2 * n :], known[:, : 2 * n], later, alpha=-1)
        solution[t] = torch.linalg.solve_triangular(half.factors[t].T, value, upper=True)
    return solution[:count]
