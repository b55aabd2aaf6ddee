"""The normal equations of a batch of motions: block-banded in time, with a border of globals.

Per frame the unknowns are ``n`` local increments; frames couple to at most their two successors
(velocity: one, acceleration: two), so the matrix is block-pentadiagonal. Two frames make one
super-block, which leaves a block-tridiagonal system that a block Cholesky factorisation solves in
time linear in the number of frames. The few unknowns that every frame sees (body shape, cameras)
form a border ("arrow"), eliminated by their Schur complement.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass
class NormalEquations:
    """Sums of ``J^T W J`` and ``J^T W r`` over all terms; minimise ``1/2 d^T H d + g^T d``.

    Shapes (B batch of motions, T frames, n unknowns a frame, m globals):
        diagonal: (B, T, n, n); next1: (B, T, n, n) couples frame t with t+1; next2: t with t+2.
        gradient: (B, T, n); border: (B, T, n, m) of frames with globals.
        corner: (B, m, m); corner_gradient: (B, m): the globals alone.
    """

    diagonal: Tensor
    next1: Tensor
    next2: Tensor
    gradient: Tensor
    border: Tensor
    corner: Tensor
    corner_gradient: Tensor

    @classmethod
    def zeros(cls, batch: int, frames: int, n: int, m: int, like: Tensor) -> "NormalEquations":
        """An empty system on the device and in the dtype of ``like``."""
        return cls(
            diagonal=like.new_zeros(batch, frames, n, n),
            next1=like.new_zeros(batch, frames, n, n),
            next2=like.new_zeros(batch, frames, n, n),
            gradient=like.new_zeros(batch, frames, n),
            border=like.new_zeros(batch, frames, n, m),
            corner=like.new_zeros(batch, m, m),
            corner_gradient=like.new_zeros(batch, m),
        )

    def solve(self, damping: Tensor, *, shared: bool) -> tuple[Tensor, Tensor]:
        """The damped Gauss-Newton step.

        Args:
            damping: (B,) Levenberg-Marquardt factor on the diagonal of each motion.
            shared: one set of globals for the whole batch (their equations are summed over it).

        Returns:
            (B, T, n) frame increments and (B, m) global increments (equal rows when shared).
        """
        m = self.corner_gradient.shape[-1]
        damped = _damped(self.diagonal, damping[:, None, None])
        right = torch.cat([self.gradient[..., None], self.border], dim=-1)
        solved = _each_motion(damped, self.next1, self.next2, right)
        frame_only, response = solved[..., 0], solved[..., 1:]
        schur = self.corner - torch.einsum("btni,btnj->bij", self.border, response)
        rest = self.corner_gradient - torch.einsum("btni,btn->bi", self.border, frame_only)
        if shared:
            schur = schur.sum(0, keepdim=True).expand_as(schur)
            rest = rest.sum(0, keepdim=True).expand_as(rest)
        if m == 0:
            return -frame_only, rest
        schur = _damped(schur, damping[:, None])
        d_globals = -torch.linalg.solve(schur, rest)
        d_frames = -frame_only - torch.einsum("btni,bi->btn", response, d_globals)
        return d_frames, d_globals

    def predicted_decrease(self, d_frames: Tensor, d_globals: Tensor) -> Tensor:
        """(B,) decrease of the cost (sum of squares, no half) that the quadratic model promises."""
        slope = (self.gradient * d_frames).sum((1, 2)) + (self.corner_gradient * d_globals).sum(1)
        return -slope


def _each_motion(diagonal: Tensor, next1: Tensor, next2: Tensor, right: Tensor) -> Tensor:
    """`solve_pentadiagonal` of every motion of the batch, on a CPU one motion a thread.

    The blocks are too small for a linear algebra library's own threads to pay.
    """
    batch = len(diagonal)
    workers = min(batch, os.cpu_count() or 1)
    if workers == 1 or diagonal.is_cuda:
        return solve_pentadiagonal(diagonal, next1, next2, right)

    def one(v: int) -> Tensor:
        row = slice(v, v + 1)
        return solve_pentadiagonal(diagonal[row], next1[row], next2[row], right[row])

    with ThreadPoolExecutor(workers) as pool:
        return torch.cat(list(pool.map(one, range(batch))))


def _damped(blocks: Tensor, damping: Tensor) -> Tensor:
    """Marquardt's scaling: the diagonal grows by ``damping`` times itself, and a floor."""
    diagonal = blocks.diagonal(dim1=-2, dim2=-1)
    floor = 1e-9 * diagonal.amax(dim=-1, keepdim=True) + 1e-9
    return blocks + torch.diag_embed(damping * diagonal + floor)


def solve_pentadiagonal(diagonal: Tensor, next1: Tensor, next2: Tensor, right: Tensor) -> Tensor:
    """Solve a symmetric positive definite block-pentadiagonal system by pairing frames.

    Args:
        diagonal, next1, next2: (B, T, n, n) blocks (t, t), (t, t+1), (t, t+2); the last one
            of ``next1`` and the last two of ``next2`` are ignored.
        right: (B, T, n, k).

    Returns:
        (B, T, n, k) solution.
    """
    batch, frames, n, _ = diagonal.shape
    if not bool(next2.any()):
        return solve_tridiagonal(diagonal, next1[:, :-1], right)
    if frames % 2:
        identity = torch.eye(n, dtype=diagonal.dtype, device=diagonal.device)
        diagonal = torch.cat([diagonal, identity.expand(batch, 1, n, n)], 1)
        next1, next2 = (
            torch.cat([x[:, : frames - keep], x.new_zeros(batch, 1 + keep, n, n)], 1)
            for x, keep in ((next1, 1), (next2, 2))
        )
        right = torch.cat([right, right.new_zeros(batch, 1, *right.shape[2:])], 1)
    even, odd = slice(0, None, 2), slice(1, None, 2)
    cross = next1[:, even]
    top = torch.cat([diagonal[:, even], cross], -1)
    bottom = torch.cat([cross.transpose(-1, -2), diagonal[:, odd]], -1)
    pair_diagonal = torch.cat([top, bottom], -2)
    last = pair_diagonal.shape[1] - 1
    zero = torch.zeros_like(cross[:, :last])
    pair_next = torch.cat(
        [
            torch.cat([next2[:, even][:, :last], zero], -1),
            torch.cat([next1[:, odd][:, :last], next2[:, odd][:, :last]], -1),
        ],
        -2,
    )
    pair_right = right.reshape(batch, last + 1, 2 * n, -1)
    solution = solve_tridiagonal(pair_diagonal, pair_next, pair_right)
    return solution.reshape(batch, -1, n, right.shape[-1])[:, :frames]


def solve_tridiagonal(diagonal: Tensor, upper: Tensor, right: Tensor) -> Tensor:
    """Block Cholesky (Thomas) solution of a symmetric positive definite block-tridiagonal system.

    Args:
        diagonal: (B, T, n, n); upper: (B, T-1, n, n) blocks (t, t+1); right: (B, T, n, k).

    Returns:
        (B, T, n, k); NaN where a block is not positive definite (the caller damps and retries).
    """
    frames = diagonal.shape[1]
    factors: list[Tensor] = []
    couplings: list[Tensor] = []
    forward: list[Tensor] = []
    block, vector = diagonal[:, 0], right[:, 0]
    for t in range(frames):
        factor, info = torch.linalg.cholesky_ex(block)
        factor = torch.where((info > 0)[:, None, None], torch.nan, factor)
        vector = torch.linalg.solve_triangular(factor, vector, upper=False)
        factors.append(factor)
        forward.append(vector)
        if t + 1 < frames:
            coupling = torch.linalg.solve_triangular(factor, upper[:, t], upper=False)
            couplings.append(coupling)
            down = coupling.transpose(-1, -2)
            block = diagonal[:, t + 1] - down @ coupling
            vector = right[:, t + 1] - down @ vector
    solution = [torch.empty(0)] * frames
    for t in range(frames - 1, -1, -1):
        vector = forward[t]
        if t + 1 < frames:
            vector = vector - couplings[t] @ solution[t + 1]
        solution[t] = torch.linalg.solve_triangular(
            factors[t].transpose(-1, -2), vector, upper=True
        )
    return torch.stack(solution, 1)
