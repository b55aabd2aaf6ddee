"""The normal equations of a batch of motions: block-banded in time, and their solution.

A frame's unknowns are ``n`` local increments. Frames couple to their two successors at most
(velocity: one, acceleration: two), so a block Cholesky factorisation takes time linear in the
frames. The few unknowns that all frames share (body shape, cameras) form a border ("arrow"),
eliminated by their Schur complement.

On a card all motions of a batch are eliminated together, frame after frame. On a processor each is
a band of 3n diagonals, which LAPACK factors in one call without Python's lock: motions on threads
do not wait for one another, and a loop over frames takes twice the time on one core. The factor's
blocks lie in the band as matrices of leading dimension 3n - 1 (column j begins j entries further
up). So solutions are products of blocks: LAPACK's own substitution reads the whole band for every
right-hand side.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from importlib import import_module

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

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


ENTRY_BYTES = 8
ARGUMENTS = {"dpbtrf": 6, "dtrsm": 11, "dgemm": 13}  # of each routine, all of them addresses


@compiled
def packed_band(diagonal, next1, next2, added):  # type: ignore[no-untyped-def]
    """The columns (T, n, 3n) of the lower triangle, each from its diagonal entry downwards.

    Args:
        diagonal, next1, next2: (T, n, n) blocks (t, t), (t, t+1), (t, t+2); the last one of
            ``next1`` and the last two of ``next2`` are ignored.
        added: (T, n) to the matrix's diagonal.
    """
    frames, n = added.shape
    band = np.empty((frames, n, 3 * n))
    for t in range(frames):
        for j in range(n):
            column = band[t, j]
            column[: n - j] = diagonal[t, j, j:]
            column[0] += added[t, j]
            column[n - j :] = 0.0
            if t + 1 < frames:
                column[n - j : 2 * n - j] = next1[t, j]
            if t + 2 < frames:
                column[2 * n - j : 3 * n - j] = next2[t, j]
    return band


class BandedCholesky:
    """The factor L of a positive definite block-pentadiagonal matrix.

    Args:
        band: its `packed_band`, which the factor replaces.

    Attributes:
        definite: whether the matrix is positive definite; if not, there is no factor.
    """

    def __init__(self, band: Float[np.ndarray, "T n w"]) -> None:
        frames, n, width = band.shape
        info = ctypes.c_int()
        integers = (frames * n, width - 1, width)
        size, diagonals, leading = (ctypes.byref(ctypes.c_int(value)) for value in integers)
        _routine("lapack", "dpbtrf")(
            b"L", size, diagonals, band.ctypes.data, leading, ctypes.byref(info)
        )
        self._band = band
        self.definite = info.value == 0

    def solve(self, right: Float[np.ndarray, "T n k"]) -> None:
        """Replace right-hand sides, a contiguous array, by the solutions."""
        frames, n, width = self._band.shape
        solve, multiply = _routine("blas", "dtrsm", True), _routine("blas", "dgemm", True)
        integers = (right.shape[2], n, 2 * n, width - 1)
        k, one, two, leading = (ctypes.byref(ctypes.c_int(value)) for value in integers)
        plus, minus = (ctypes.byref(ctypes.c_double(sign)) for sign in (1.0, -1.0))
        step, band_step = right.shape[2] * n * ENTRY_BYTES, n * width * ENTRY_BYTES
        heights = [two] * (frames - 2) + [one] * (frames > 1) + [None]  # of the blocks below
        places = [
            (self._band.ctypes.data + t * band_step, right.ctypes.data + t * step, height)
            for t, height in enumerate(heights)
        ]
        below = n * ENTRY_BYTES
        for L, here, m in places:
            solve(b"R", b"L", b"T", b"N", k, one, plus, L, leading, here, k)
            if m is not None:
                multiply(
                    b"N", b"T", k, m, one, minus, here, k, L + below, leading, plus, here + step, k
                )
        for L, here, m in reversed(places):
            if m is not None:
                multiply(
                    b"N", b"N", k, one, m, minus, here + step, k, L + below, leading, plus, here, k
                )
            solve(b"R", b"L", b"N", b"N", k, one, plus, L, leading, here, k)


@cache
def _routine(library: str, name: str, keeps_lock: bool = False) -> Callable[..., None]:
    """A routine of the LAPACK or BLAS that SciPy brings.

    Args:
        keeps_lock: Python's, in short calls, where to hand it over costs more than it gives.
    """
    capsule = import_module(f"scipy.linalg.cython_{library}").__pyx_capi__[name]
    name_of, pointer_of = ctypes.pythonapi.PyCapsule_GetName, ctypes.pythonapi.PyCapsule_GetPointer
    name_of.restype, name_of.argtypes = ctypes.c_char_p, [ctypes.py_object]
    pointer_of.restype = ctypes.c_void_p
    pointer_of.argtypes = [ctypes.py_object, ctypes.c_char_p]
    prototype = ctypes.PYFUNCTYPE if keeps_lock else ctypes.CFUNCTYPE
    kind = prototype(None, *[ctypes.c_void_p] * ARGUMENTS[name])
    return kind(pointer_of(capsule, name_of(capsule)))


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

    def reduce(self, damping: float | Tensor, *, in_place: bool = False) -> Reduced:
        """Eliminate the frames.

        Args:
            damping: Levenberg-Marquardt factor on the diagonal, one or (B, 1, 1).
            in_place: the blocks of the frames are dropped as soon as they are factored.
        """
        solved = self._solved(damping, in_place)
        frame_only, response = solved[..., 0], solved[..., 1:]
        schur = self.corner - torch.einsum("btni,btnj->bij", self.border, response)
        rest = self.corner_gradient - torch.einsum("btni,btn->bi", self.border, frame_only)
        return Reduced(frame_only, response, schur, rest)

    def _solved(self, damping: float | Tensor, in_place: bool) -> Float[Tensor, "B T n k"]:
        """Of the frames alone: with the gradient and the border on the right."""
        right = torch.cat([self.gradient[..., None], self.border], dim=-1)
        if not for_processor(right):
            damped = _damped(self.diagonal.clone(), damping)
            return solve_pentadiagonal(damped, self.next1, self.next2, right)
        added = _addition(self.diagonal.diagonal(dim1=-2, dim2=-1), damping)
        system = (self.diagonal, self.next1, self.next2, added)
        bands = [packed_band(*motion) for motion in zip(*(x.numpy() for x in system), strict=True)]
        if in_place:
            del system
            self.diagonal = self.next1 = self.next2 = right.new_empty(0)
        for motion, values in zip(map(BandedCholesky, bands), right.numpy(), strict=True):
            if motion.definite:
                motion.solve(values)
            else:
                values[:] = torch.nan
        return right


def for_processor(values: Tensor) -> bool:
    """Whether LAPACK and compiled loops take them: on a processor, in double precision."""
    return not values.is_cuda and values.dtype == torch.float64


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
    diagonal.add_(_addition(diagonal, damping))
    return blocks


def _addition(diagonal: Tensor, damping: float | Tensor) -> Tensor:
    floor = 1e-9 * diagonal.amax(dim=-1, keepdim=True) + 1e-9
    return damping * diagonal + floor
