"""The normal equations of a batch of motions: block-banded in time, and their solution.

A frame's unknowns are ``n`` local increments. Frames couple to their two successors at most
(velocity: one, acceleration: two), so a block Cholesky factorisation takes time linear in the
frames. From both ends towards two frames in the middle it takes as many operations as from one end,
but the halves can be worked on at the same time. The few unknowns that all frames share (body
shape, cameras) form a border ("arrow"), eliminated by their Schur complement. Nearly all memory is
in the factors: a large system can be factored in place, and nothing is held twice.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.workers import MapFn, serial_map

MIDDLE = 2  # frames between the halves: as many as a frame couples to
BLOCK = 32  # frames whose columns are laid out at once


@dataclass(frozen=True)
class Half:
    """Eliminated frames, the outermost first.

    Attributes:
        factors: each frame's Cholesky factor L (n, n); ``L^-1 [next1 | next2]`` transposed, in one
            or two parts of (2n, n); and ``L^-1 right`` transposed (k, n).
        middle: (MIDDLE, 3n + k, n) columns of the next frames, after elimination.
        failed: () nonzero where the matrix is not positive definite.
    """

    factors: list[_Factors]
    middle: Tensor
    failed: Tensor


_Factors = tuple[Tensor, tuple[Tensor, ...], Tensor]
_Places = tuple[Tensor, Tensor, Tensor, Tensor]  # of a frame's diagonal, next1, next2, right


def solve_pentadiagonal(
    diagonal: Float[Tensor, "T n n"],
    next1: Float[Tensor, "T n n"],
    next2: Float[Tensor, "T n n"],
    right: Float[Tensor, "T n k"],
    each: MapFn = serial_map,
    *,
    in_place: bool = False,
) -> Float[Tensor, "T n k"]:
    """Solve a symmetric positive definite block-pentadiagonal system.

    Args:
        diagonal, next1, next2: blocks (t, t), (t, t+1), (t, t+2); the last one of ``next1`` and
            the last two of ``next2`` are ignored.
        each: runs the two halves.
        in_place: the factors replace the system, ``right`` included.

    Returns:
        The solution, NaN where the matrix is not positive definite (the caller damps and
        retries).
    """
    frames = len(diagonal)
    if frames < MIDDLE:
        factor, info = torch.linalg.cholesky_ex(diagonal)
        return torch.where(info != 0, torch.nan, torch.cholesky_solve(right, factor))
    first = (frames - MIDDLE) // 2
    system = (diagonal, next1, next2, right)
    columns = [_from_first(*system, first), _from_last(*system, first)]
    places = _places(*system, first) if in_place else (None, None)
    halves = each(_eliminated, list(zip(columns, places, strict=True)))
    middle, info = _middle(halves[0].middle, halves[1].middle)
    solution = right.new_empty(frames, right.shape[2], right.shape[1])
    solution[first : first + MIDDLE] = middle
    ends = solution[:first].unbind(), solution[first + MIDDLE :].unbind()[::-1]
    each(_substitute, [(halves[0], middle, ends[0]), (halves[1], middle.flip(0), ends[1])])
    failed = halves[0].failed | halves[1].failed | info
    return solution.masked_fill_(failed != 0, torch.nan).mT


def _from_first(
    diagonal: Tensor, next1: Tensor, next2: Tensor, right: Tensor, first: int
) -> Iterator[Tensor]:
    """(3n + k, n) columns [diagonal; next1^T; next2^T; right^T] of each frame, the middle's last.

    Contiguous for a library of column-major routines, and so is each frame's update.
    """
    for start in range(0, first + MIDDLE, BLOCK):
        part = slice(start, min(start + BLOCK, first + MIDDLE))
        yield from torch.cat([diagonal[part], next1[part].mT, next2[part].mT, right[part].mT], 1)


def _from_last(
    diagonal: Tensor, next1: Tensor, next2: Tensor, right: Tensor, first: int
) -> Iterator[Tensor]:
    """The same from the last frame backwards; the middle's own values are in the other half."""
    frames, n = diagonal.shape[:2]
    last = first + MIDDLE
    for stop in range(frames, last, -BLOCK):
        start = max(stop - BLOCK, last)
        sources = (
            diagonal[start:stop], next1[start - 1 : stop - 1], next2[start - 2 : stop - 2],
            right[start:stop].mT,
        )  # fmt: skip
        yield from torch.cat(sources, 1).flip(0)
    yield from diagonal.new_zeros(MIDDLE, 3 * n + right.shape[2], n)


def _places(
    diagonal: Tensor, next1: Tensor, next2: Tensor, right: Tensor, first: int
) -> tuple[list[_Places], list[_Places]]:
    """Where each half's factors go: in the place of the blocks that they are made of, columns in a
    row as the library returns them, so that the rounding is the same."""
    last = first + MIDDLE
    ahead = diagonal[:first].mT, next1[:first], next2[:first], right[:first].mT
    back = diagonal[last:].mT, next1[last - 1 : -1], next2[last - 2 : -2], right[last:].mT
    return list(zip(*ahead, strict=True)), list(zip(*back, strict=True))[::-1]


def _eliminated(work: tuple[Iterator[Tensor], Sequence[_Places] | None]) -> Half:
    """All frames but the last two. A frame's factor L gives A = L^-1 [next1 | next2 | right]; the
    products of A's columns are subtracted from the two frames after it."""
    columns, places = work
    factors: list[_Factors] = []
    frame, after = next(columns), next(columns)
    n, failed = frame.shape[1], frame.new_zeros((), dtype=torch.int32)
    for last in columns:
        factor, info = torch.linalg.cholesky_ex(frame[:n])
        solved = torch.linalg.solve_triangular(factor, frame[n:].T, upper=False).T
        one, two, right = solved.split((n, n, len(solved) - 2 * n))
        after[: 2 * n].addmm_(solved[: 2 * n], one.T, alpha=-1)
        after[3 * n :].addmm_(right, one.T, alpha=-1)
        last[:n].addmm_(two, two.T, alpha=-1)
        last[3 * n :].addmm_(right, two.T, alpha=-1)
        failed |= info
        if places is None:
            factors.append((factor, (solved[: 2 * n],), right))
        else:
            factors.append(_put(places[len(factors)], factor, one, two, right))
        frame, after = after, last
    return Half(factors, torch.stack([frame, after]), failed)


def _put(places: _Places, *values: Tensor) -> _Factors:
    """Factors in their places."""
    for place, value in zip(places, values, strict=True):
        place.copy_(value)
    factor, one, two, right = places
    return factor, (one, two), right


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


def _substitute(work: tuple[Half, Tensor, Sequence[Tensor]]) -> None:
    """Write the (k, n) solution of the half's frames, given the middle's in the half's order."""
    half, middle, solution = work
    near, far = middle.unbind()
    for (factor, parts, right), place in zip(half.factors[::-1], solution[::-1], strict=True):
        coupling = parts[0] if len(parts) == 1 else torch.cat(parts)
        if len(parts) > 1:  # the library rounds by where in memory a matrix begins
            factor = factor.clone()
        value = torch.addmm(right, torch.cat([near, far], 1), coupling, alpha=-1)
        near, far = torch.linalg.solve_triangular(factor.T, value.T, upper=True).T, near
        place.copy_(near)


@dataclass(frozen=True)
class Reduced:
    """A system whose frames have been eliminated.

    Attributes:
        frame_only: (B, T, n) increments if the globals stayed; response: (B, T, n, m) their
            derivative by the globals; both with the opposite sign.
        schur: (B, m, m), rest: (B, m): the equations of the globals alone.
    """

    frame_only: Float[Tensor, "B T n"]
    response: Float[Tensor, "B T n m"]
    schur: Float[Tensor, "B m m"]
    rest: Float[Tensor, "B m"]

    def frames(self, d_globals: Float[Tensor, "B m"]) -> Float[Tensor, "B T n"]:
        """Frame increments that go with global ones."""
        return -self.frame_only - torch.einsum("btni,bi->btn", self.response, d_globals)


def solve_globals(reduced: Sequence[Reduced], damping: float) -> Float[Tensor, " m"]:
    """Increments of the globals that all these motions share."""
    schur = torch.stack([r.schur.sum(0) for r in reduced]).sum(0)
    rest = torch.stack([r.rest.sum(0) for r in reduced]).sum(0)
    if len(rest) == 0:
        return rest
    return -torch.linalg.solve(_damped(schur.clone(), damping), rest)


@dataclass
class NormalEquations:
    """Sums of ``J^T W J`` and ``J^T W r`` over all terms; minimise ``1/2 d^T H d + g^T d``.

    Shapes (B batch of motions, T frames, n unknowns a frame, m globals):
        diagonal: (B, T, n, n); next1: (B, T, n, n) couples frame t with t+1; next2: t with t+2.
        gradient: (B, T, n); border: (B, T, n, m) of frames with globals.
        corner: (B, m, m); corner_gradient: (B, m): the globals alone.
    """

    diagonal: Float[Tensor, "B T n n"]
    next1: Float[Tensor, "B T n n"]
    next2: Float[Tensor, "B T n n"]
    gradient: Float[Tensor, "B T n"]
    border: Float[Tensor, "B T n m"]
    corner: Float[Tensor, "B m m"]
    corner_gradient: Float[Tensor, "B m"]

    @classmethod
    def zeros(cls, batch: int, frames: int, n: int, m: int, template: Tensor) -> NormalEquations:
        """An empty system on the device and in the dtype of ``template``."""
        return cls(
            diagonal=template.new_zeros(batch, frames, n, n),
            next1=template.new_zeros(batch, frames, n, n),
            next2=template.new_zeros(batch, frames, n, n),
            gradient=template.new_zeros(batch, frames, n),
            border=template.new_zeros(batch, frames, n, m),
            corner=template.new_zeros(batch, m, m),
            corner_gradient=template.new_zeros(batch, m),
        )

    def plus(self, other: NormalEquations) -> NormalEquations:
        """This system with another one added to it, in place."""
        for field in fields(self):
            getattr(self, field.name).add_(getattr(other, field.name))
        return self

    def times(self, factor: float) -> NormalEquations:
        """This system multiplied by a number, in place."""
        for field in fields(self):
            getattr(self, field.name).mul_(factor)
        return self

    def of_frames(self, frames: slice) -> NormalEquations:
        """The equations of some frames: what is added to these is added to the whole."""
        names = ("diagonal", "next1", "next2", "gradient", "border")
        return replace(self, **{name: getattr(self, name)[:, frames] for name in names})

    def reduce(
        self, damping: float | Tensor, each: MapFn = serial_map, *, in_place: bool = False
    ) -> Reduced:
        """Eliminate the frames.

        Args:
            damping: Levenberg-Marquardt factor on the diagonal, one or (B, 1, 1).
            each: runs the two halves of a motion.
            in_place: the blocks of the frames are lost, and no memory for as many is needed.
        """
        right = torch.cat([self.gradient[..., None], self.border], dim=-1)
        damped = _damped(self.diagonal if in_place else self.diagonal.clone(), damping)
        systems = zip(damped, self.next1, self.next2, right, strict=True)
        solved = torch.stack(
            [solve_pentadiagonal(*system, each, in_place=in_place) for system in systems]
        )
        frame_only, response = solved[..., 0], solved[..., 1:]
        schur = self.corner - torch.einsum("btni,btnj->bij", self.border, response)
        rest = self.corner_gradient - torch.einsum("btni,btn->bi", self.border, frame_only)
        return Reduced(frame_only, response, schur, rest)


def add_product(
    target: Float[Tensor, "B T n m"],
    left: Float[Tensor, "B T r n"],
    right: Float[Tensor, "B T r m"],
    share: float = 1.0,
) -> None:
    """Add ``share * left^T right`` to a target in place."""
    for of_motion, a, b in zip(target, left, right, strict=True):
        of_motion.baddbmm_(a.mT, b, alpha=share)


def _damped(blocks: Tensor, damping: float | Tensor) -> Tensor:
    """Marquardt's scaling, in place: ``damping`` times the diagonal is added to it, and a floor."""
    diagonal = blocks.diagonal(dim1=-2, dim2=-1)
    floor = 1e-9 * diagonal.amax(dim=-1, keepdim=True) + 1e-9
    diagonal.add_(damping * diagonal + floor)
    return blocks
