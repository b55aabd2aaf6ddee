"""Selected inversion: the diagonal blocks of the inverse of a block-pentadiagonal matrix.

With ``H = W^T D W``, W unit upper and as banded as H, the inverse's blocks follow from the last
frame to the first (Takahashi et al., 1973): given the two frames after it, frame t is
``-U_t [x_{t+1}; x_{t+2}]`` plus an independent part of covariance ``D_t^-1``. Time is linear in the
number of frames; the dense inverse is never formed.

The factors are three times as large as the inverse's blocks, and each is needed once. So those of
`HELD` frames are in memory at a time: of longer motions the elimination is repeated from what it
had come to before every `HELD` frames.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

FLOOR = 1e-12  # of a block's largest diagonal entry, so that unobserved unknowns stay finite
HELD = 512  # frames whose factors are in memory at once: 0.1 GB
PIECE = 128  # frames of the inverse that are handed over at once


@dataclass(frozen=True)
class InversePiece:
    """Some frames of ``H^-1``; NaN where H is not positive definite.

    Attributes:
        frames: which (P of them).
        diagonal: (P, n, n) its blocks (t, t).
        solution: (P, n, k) of ``H x = right``.
    """

    frames: slice
    diagonal: Float[Tensor, "P n n"]
    solution: Float[Tensor, "P n k"]


@dataclass(frozen=True)
class _Eliminated:
    """One frame: Cholesky factor (n, n) of D's block, U_t (n, 2n), right-hand sides (n, k)."""

    factor: Tensor
    after: Tensor
    right: Tensor


@dataclass(frozen=True)
class _System:
    """Its frames as columns ``[diagonal | next1 | right]``, (n, 2n + k); zeros beyond the last."""

    diagonal: Tensor
    next1: Tensor
    next2: Tensor
    right: Callable[[int], Tensor]

    def columns(self, t: int) -> Tensor:
        """A copy of frame t's, with the floor on its diagonal."""
        frames, n = self.diagonal.shape[:2]
        if t >= frames:
            return torch.zeros_like(self.columns(frames - 1))
        beside = self.next1[t] if t + 1 < frames else torch.zeros_like(self.next1[t])
        columns = torch.cat([self.diagonal[t], beside, self.right(t)], 1)
        entries = columns[:, :n].diagonal()
        entries.add_(FLOOR * entries.amax() + FLOOR)
        return columns

    def far(self, t: int) -> Tensor:
        """Block (t, t + 2)."""
        return self.next2[t] if t + 2 < len(self.diagonal) else torch.zeros_like(self.next2[t])


_Front = tuple[Tensor, Tensor]  # columns of the next two frames, after the elimination so far


def selected_inverse(
    diagonal: Float[Tensor, "T n n"],
    next1: Float[Tensor, "T n n"],
    next2: Float[Tensor, "T n n"],
    right: Callable[[int], Float[Tensor, "n k"]] | None = None,
) -> Iterator[InversePiece]:
    """The inverse's diagonal blocks and the solution of a linear system, last frames first.

    Args:
        diagonal, next1, next2: blocks (t, t), (t, t+1), (t, t+2), of equal shape; the last one of
            ``next1`` and the last two of ``next2`` are ignored.
        right: the right-hand sides of a frame; none by default.
    """
    system = _System(diagonal, next1, next2, right or (lambda t: diagonal[t, :, :0]))
    return _backwards(system, [*_spans(range(len(diagonal)), HELD)])


def _backwards(system: _System, spans: list[range]) -> Iterator[InversePiece]:
    fronts, part = [(system.columns(0), system.columns(1))], list[_Eliminated]()
    ok = True
    for span in spans:
        front, failed = _eliminate(system, span, fronts[-1], part if span is spans[-1] else None)
        fronts.append(front)
        ok &= not failed
    n, width = fronts[0][0].shape
    later = system.diagonal.new_zeros(2 * n, width)  # [inverse | solution] of the two frames after
    for span, front in zip(reversed(spans), fronts[-2::-1], strict=True):
        if span is not spans[-1]:
            _eliminate(system, span, front, part)
        for piece in reversed([*_spans(span, PIECE)]):
            rows = []
            for t in reversed(piece):
                later = _substituted(part[t - span.start], later)
                rows.append(torch.cat([later[:n, :n], later[:n, 2 * n :]], 1))
            del part[piece.start - span.start :]
            inverse, solution = torch.stack(rows[::-1]).split([n, width - 2 * n], 2)
            if not ok:
                inverse, solution = (torch.full_like(x, torch.nan) for x in (inverse, solution))
            yield InversePiece(slice(piece.start, piece.stop), inverse, solution)


def _spans(frames: range, size: int) -> Iterator[range]:
    for first in range(frames.start, frames.stop, size):
        yield range(first, min(first + size, frames.stop))


def _eliminate(
    system: _System, span: range, front: _Front, eliminated: list[_Eliminated] | None
) -> tuple[_Front, bool]:
    """Eliminate some frames, which are added to ``eliminated``.

    Returns:
        What is left of the two frames after them, and whether H is not positive definite.
    """
    frame, near = (x.clone() for x in front)
    n, failed = len(frame), torch.zeros((), dtype=torch.int32, device=frame.device)
    for t in span:
        far = system.columns(t + 2)
        factor, info = torch.linalg.cholesky_ex(frame[:, :n])
        failed |= info
        right = frame[:, 2 * n :].clone()
        coupled = torch.cat([frame[:, n : 2 * n], system.far(t)], 1)
        after = torch.cholesky_solve(coupled, factor)
        near.addmm_(after[:, :n].T, torch.cat([coupled, right], 1), alpha=-1)
        far[:, :n].addmm_(after[:, n:].T, coupled[:, n:], alpha=-1)
        far[:, 2 * n :].addmm_(after[:, n:].T, right, alpha=-1)
        if eliminated is not None:
            eliminated.append(_Eliminated(factor, after, right))
        frame, near = near, far
    return (frame, near), bool(failed)


def _substituted(frame: _Eliminated, later: Tensor) -> Tensor:
    """(2n, 2n + k) inverse and solution at a frame and the one after it, from those at the two
    frames after it."""
    n = len(frame.factor)
    carried = frame.after @ later
    cross = -carried[:, : 2 * n]
    block = torch.cholesky_inverse(frame.factor) - cross @ frame.after.T
    block = (block + block.T) / 2
    value = torch.cholesky_solve(frame.right, frame.factor) - carried[:, 2 * n :]
    first = torch.cat([block, cross[:, :n], value], 1)
    second = torch.cat([cross[:, :n].T, later[:n, :n], later[:n, 2 * n :]], 1)
    return torch.cat([first, second])
