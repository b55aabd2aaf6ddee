"""The normal equations of a batch of motions: block-banded in time, and their solution.

A frame's unknowns are ``n`` local increments. Frames couple to their two successors at most
(velocity: one, acceleration: two), so a block Cholesky factorisation takes time linear in the
frames. The few unknowns that all frames share (body shape, cameras) form a border ("arrow"),
eliminated by their Schur complement.

On a card all motions of a batch are eliminated together, frame after frame. On a processor a frame
is a panel of three blocks and k right-hand sides, and one compiled loop over the frames calls the
BLAS and LAPACK that SciPy brings, without Python's lock: motions on threads do not wait for one
another. Right-hand sides are further rows of a panel, so that what replaces them is the forward
substitution; blocks outside of the band are never touched (LAPACK's dpbtrf, which takes a band of
3n diagonals, has half as many operations again). The loop is compiled once and kept, so it takes
the routines' addresses as arguments: they are others in every process.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.rotations import for_processor
from imocap_core.workers import compiled


def solve_pentadiagonal(
    diagonal: Float[Tensor, "B T n n"],
    next1: Float[Tensor, "B T n n"],
    next2: Float[Tensor, "B T n n"],
    right: Float[Tensor, "B T n k"],
) -> Float[Tensor, "B T n k"]:
    """Solve symmetric positive definite block-pentadiagonal systems, frame after frame.

    Args:
        diagonal, next1, next2: blocks (t, t), (t, t+1), (t, t+2); the last one of ``next1`` and
            the last two of ``next2`` are ignored.

    Returns:
        The solutions, NaN where a matrix is not positive definite (the caller damps and retries).
    """
    frames, n = diagonal.shape[1:3]
    ahead = torch.cat([next1, next2], -1)
    ahead[:, -1:] = ahead[:, -2:, :, n:] = 0.0
    system = torch.cat([diagonal, ahead, right], -1)
    factors, failed = [], diagonal.new_zeros(len(diagonal), dtype=torch.int32)
    for t in range(frames):
        factor, info = torch.linalg.cholesky_ex(system[:, t, :, :n])
        failed |= info
        coupled = torch.linalg.solve_triangular(factor, system[:, t, :, n:], upper=False)
        one, two, value = coupled.split([n, n, right.shape[3]], -1)
        factors.append((factor, coupled))
        if t + 1 < frames:
            system[:, t + 1, :, : 2 * n] -= one.mT @ coupled[..., : 2 * n]
            system[:, t + 1, :, 3 * n :] -= one.mT @ value
        if t + 2 < frames:
            system[:, t + 2, :, :n] -= two.mT @ two
            system[:, t + 2, :, 3 * n :] -= two.mT @ value
    later = right.new_zeros(len(right), 2 * n, right.shape[3])
    solution = torch.empty_like(right)
    for t, (factor, coupled) in reversed([*enumerate(factors)]):
        value = coupled[..., 2 * n :] - coupled[..., : 2 * n] @ later
        solution[:, t] = torch.linalg.solve_triangular(factor.mT, value, upper=True)
        later = torch.cat([solution[:, t], later[:, :n]], 1)
    return solution.masked_fill_((failed != 0)[:, None, None, None], torch.nan)


def _make_call_at() -> Callable[..., None]:
    from llvmlite import ir  # type: ignore[import-untyped]
    from numba import types
    from numba.extending import intrinsic

    def call(typing: Any, address: Any, arguments: Any) -> Any:
        def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            whole = ir.IntType(8 * ctypes.sizeof(ctypes.c_void_p))
            routine = ir.FunctionType(ir.VoidType(), [whole] * len(arguments))
            pointer = builder.inttoptr(values[0], routine.as_pointer())
            of_tuple = range(len(arguments))
            builder.call(pointer, [builder.extract_value(values[1], k) for k in of_tuple])
            return context.get_dummy_value()

        return types.void(address, arguments), code

    routine: Callable[..., None] = intrinsic(call)
    return routine


_call_at = _make_call_at()
"""In compiled loops: call a routine, of C or Fortran, at an address with a tuple of addresses."""


LETTERS = np.frombuffer(b"LRNT", np.uint8)
ONE, MINUS_ONE = np.ones(1), -np.ones(1)


@cache
def _routines() -> tuple[int, ...]:
    """Addresses of dpotrf, dsyrk, dtrsm and dgemm."""
    name_of, pointer_of = ctypes.pythonapi.PyCapsule_GetName, ctypes.pythonapi.PyCapsule_GetPointer
    name_of.restype, name_of.argtypes = ctypes.c_char_p, [ctypes.py_object]
    pointer_of.restype = ctypes.c_void_p
    pointer_of.argtypes = [ctypes.py_object, ctypes.c_char_p]
    addresses = []
    for name in ("dpotrf", "dsyrk", "dtrsm", "dgemm"):
        library = "lapack" if name == "dpotrf" else "blas"
        capsule = import_module(f"scipy.linalg.cython_{library}").__pyx_capi__[name]
        addresses.append(pointer_of(capsule, name_of(capsule)))
    return tuple(addresses)


class BlockCholesky:
    """The factor L of a positive definite block-pentadiagonal matrix.

    Args:
        panels: (T, n, 3n + k) blocks (t, t), (t, t+1), (t, t+2), zeros beyond the last frame, and
            right-hand sides; replaced by those of L^T and by ``L^-1 right``.

    Attributes:
        definite: whether the matrix is positive definite; if not, there is no factor, and the
            right-hand sides are NaN.
    """

    def __init__(self, panels: Float[np.ndarray, "T n w"]) -> None:
        self._panels = panels
        self.definite = bool(_factor(panels, LETTERS, ONE, MINUS_ONE, *_routines()))
        if not self.definite:
            panels[:, :, 3 * panels.shape[1] :] = np.nan

    def substitute_back(self, values: Float[np.ndarray, "T n k"]) -> None:
        """Replace values, a contiguous array, by ``L^-T values``."""
        _backward(self._panels, values, LETTERS, ONE, MINUS_ONE, *_routines()[2:])


@compiled
def _factor(panels, letters, one, minus_one, dpotrf, dsyrk, dtrsm, dgemm):  # type: ignore[no-untyped-def]
    """Factor panels in place; whether the matrix is positive definite.

    To BLAS a panel is a matrix of n columns: its blocks one below the other. The two frames ahead
    lose what couples them to this one, of a symmetric block the lower triangle alone.
    """
    frames, n, width = panels.shape
    sizes = np.array([n, width, width - n, width - 3 * n], np.intc)
    info = np.zeros(1, np.intc)
    n_at, width_at, below_at, sides_at = [sizes.ctypes.data + 4 * i for i in range(4)]
    lower, right, no, transposed = [letters.ctypes.data + i for i in range(4)]
    plus, minus = one.ctypes.data, minus_one.ctypes.data
    for t in range(frames):
        block = 8 * sizes[0]  # the array lives as long as it is read
        step = width * block
        L = panels.ctypes.data + t * step
        _call_at(dpotrf, (lower, n_at, L, width_at, info.ctypes.data))
        if info[0] != 0:
            return False
        _call_at(
            dtrsm,
            (right, lower, transposed, no, below_at, n_at, plus, L, width_at, L + block, width_at),
        )
        for ahead in range(1, min(3, frames - t)):
            by, to = L + ahead * block, L + ahead * step
            _call_at(dsyrk, (lower, no, n_at, n_at, minus, by, width_at, plus, to, width_at))
            parts = [(n_at, L + 2 * block, to + block), (sides_at, L + 3 * block, to + 3 * block)]
            for rows, coupled, target in parts[ahead - 1 :]:
                _call_at(
                    dgemm,
                    (no, transposed, rows, n_at, n_at, minus, coupled, width_at, by, width_at,
                     plus, target, width_at),
                )  # fmt: skip
    return True


@compiled
def _backward(panels, values, letters, one, minus_one, dtrsm, dgemm):  # type: ignore[no-untyped-def]
    """`BlockCholesky.substitute_back`: from the last frame to the first."""
    frames, n, width = panels.shape
    columns = values.shape[2]
    sizes = np.array([n, width, columns, 2 * n], np.intc)
    n_at, width_at, columns_at, two_at = [sizes.ctypes.data + 4 * i for i in range(4)]
    lower, right, no = [letters.ctypes.data + i for i in range(3)]
    plus, minus = one.ctypes.data, minus_one.ctypes.data
    for t in range(frames - 1, -1, -1):
        block = 8 * sizes[0]  # the array lives as long as it is read
        L = panels.ctypes.data + t * block * width
        here = values.ctypes.data + t * block * columns
        if t + 1 < frames:
            rows = two_at if t + 2 < frames else n_at
            _call_at(
                dgemm,
                (no, no, columns_at, n_at, rows, minus, here + block * columns, columns_at,
                 L + block, width_at, plus, here, columns_at),
            )  # fmt: skip
        _call_at(
            dtrsm,
            (right, lower, no, no, columns_at, n_at, plus, L, width_at, here, columns_at),
        )  # fmt: skip


@dataclass(frozen=True)
class Reduced:
    """A system whose frames have been eliminated.

    Attributes:
        frame_only: (B, T, n) increments if the globals stayed; response: (B, T, n, m) their
            derivative by the globals; both with the opposite sign, and multiplied by ``L^T`` where
            there are factors.
        schur: (B, m, m), rest: (B, m): the equations of the globals alone.
        factors: L of every motion; none where the increments are solved for.
    """

    frame_only: Float[Tensor, "B T n"]
    response: Float[Tensor, "B T n m"]
    schur: Float[Tensor, "B m m"]
    rest: Float[Tensor, "B m"]
    factors: Sequence[BlockCholesky] = ()

    def frames(self, d_globals: Float[Tensor, "B m"]) -> Float[Tensor, "B T n"]:
        """Frame increments that go with global ones."""
        values = -self.frame_only - torch.einsum("btni,bi->btn", self.response, d_globals)
        if self.factors:
            _substitute_back(self.factors, values[..., None])
        return values


def _substitute_back(factors: Sequence[BlockCholesky], values: Float[Tensor, "B T n k"]) -> None:
    """Replace values, a contiguous tensor, by the solutions, where there is a factor."""
    for factor, of_motion in zip(factors, values.numpy(), strict=True):
        if factor.definite:
            factor.substitute_back(of_motion)


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

    def add_columns(
        self,
        frames: Float[Tensor, "B T n k1"],
        rows: Float[Tensor, "B R k1"],
        pull: Float[Tensor, "B R k1"],
    ) -> None:
        """Add what couples frames with the first k globals, and gradients, their last columns.

        Args:
            frames: ``J^T W [S | r]`` of the frames' derivatives J, the globals' S, residuals r.
            rows: [S | r]; pull: W [S | r].
        """
        count = rows.shape[-1] - 1
        self.border[..., :count] += frames[..., :count]
        self.gradient += frames[..., count]
        corner = rows[..., :count].mT @ pull
        self.corner[:, :count, :count] += corner[..., :count]
        self.corner_gradient[:, :count] += corner[..., count]

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
        self, damping: float | Tensor, *, in_place: bool = False, factored: bool = True
    ) -> Reduced:
        """Eliminate the frames.

        Args:
            damping: Levenberg-Marquardt factor on the diagonal, one or (B, 1, 1).
            in_place: the blocks of the frames are dropped before they are factored.
            factored: the factors are kept: one right-hand side is solved for instead of 1 + m.
        """
        right = torch.cat([self.gradient[..., None], self.border], dim=-1)
        if not for_processor(right):
            damped = _damped(self.diagonal.clone(), damping)
            solved = solve_pentadiagonal(damped, self.next1, self.next2, right)
            return self._reduced(solved, right)
        panels = torch.cat([self.diagonal, self.next1, self.next2, right], dim=-1)
        n = right.shape[2]
        _damped(panels[..., :n], damping)
        panels[:, -1:, :, n : 3 * n] = panels[:, -2:, :, 2 * n : 3 * n] = 0.0
        if in_place:
            self.diagonal = self.next1 = self.next2 = right.new_empty(0)
        factors = [BlockCholesky(motion) for motion in panels.numpy()]
        forward = panels[..., 3 * n :].contiguous()
        if factored:
            return self._reduced(forward, forward, factors)
        _substitute_back(factors, forward)
        return self._reduced(forward, right)

    def _reduced(
        self, solved: Tensor, right: Tensor, factors: Sequence[BlockCholesky] = ()
    ) -> Reduced:
        """With the frames' equations solved (B, T, n, 1 + m), or both sides multiplied by L^-1."""
        product = right.flatten(1, 2).mT @ solved.flatten(1, 2)
        schur, rest = self.corner - product[:, 1:, 1:], self.corner_gradient - product[:, 1:, 0]
        return Reduced(solved[..., 0], solved[..., 1:], schur, rest, factors)


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
