"""The normal equations of a batch of motions: block-banded in time, with a border of globals.

Per frame the unknowns are ``n`` local increments; frames couple to at most their two successors
(velocity: one, acceleration: two), so the matrix is block-pentadiagonal, and a block Cholesky
factorisation solves it in time linear in the number of frames. The few unknowns that all frames
share (body shape, cameras) form a border ("arrow"), eliminated by their Schur complement.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.solver.pentadiagonal import solve_pentadiagonal
from imocap_core.workers import Each, in_turn


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
        self, damping: float | Tensor, each: Each = in_turn, *, in_place: bool = False
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
