"""The block-banded solver against the dense matrix it stands for."""

import pytest
import torch
from torch import Tensor

from imocap_core.motion.normal import NormalEquations, solve_pentadiagonal


def banded(frames: int, n: int, *, accelerations: bool) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """A random positive definite system as blocks and as a dense matrix."""
    generator = torch.Generator().manual_seed(frames)
    rows = torch.randn(2, frames, 2 * n, n, generator=generator, dtype=torch.float64)
    diagonal = rows.transpose(-1, -2) @ rows + 20 * torch.eye(n, dtype=torch.float64)
    next1 = torch.randn(2, frames, n, n, generator=generator, dtype=torch.float64)
    next2 = torch.randn(2, frames, n, n, generator=generator, dtype=torch.float64)
    next2 = next2 if accelerations else torch.zeros_like(next2)
    dense = torch.zeros(2, frames * n, frames * n, dtype=torch.float64)
    for t in range(frames):
        for step, block in ((0, diagonal), (1, next1), (2, next2)):
            if t + step < frames:
                a, b = slice(t * n, t * n + n), slice((t + step) * n, (t + step) * n + n)
                dense[:, a, b] = block[:, t]
                dense[:, b, a] = block[:, t].transpose(-1, -2)
    return diagonal, next1, next2, dense


@pytest.mark.parametrize("frames", [1, 2, 3, 6, 7])
@pytest.mark.parametrize("accelerations", [False, True])
def test_solution_is_the_dense_one(frames: int, accelerations: bool) -> None:
    diagonal, next1, next2, dense = banded(frames, 4, accelerations=accelerations)
    right = torch.randn(2, frames, 4, 3, dtype=torch.float64)
    found = solve_pentadiagonal(diagonal, next1, next2, right)
    expected = torch.linalg.solve(dense, right.reshape(2, -1, 3)).reshape(found.shape)
    assert torch.allclose(found, expected, atol=1e-10)


@pytest.mark.parametrize("shared", [False, True])
def test_border_is_eliminated_exactly(shared: bool) -> None:
    frames, n, m = 5, 3, 2
    diagonal, next1, next2, dense = banded(frames, n, accelerations=True)
    normal = NormalEquations.zeros(2, frames, n, m, diagonal)
    normal.diagonal, normal.next1, normal.next2 = diagonal, next1, next2
    normal.gradient = torch.randn(2, frames, n, dtype=torch.float64)
    normal.border = torch.randn(2, frames, n, m, dtype=torch.float64)
    normal.corner = 200 * torch.eye(m, dtype=torch.float64).repeat(2, 1, 1)
    normal.corner_gradient = torch.randn(2, m, dtype=torch.float64)
    d_frames, d_globals = normal.solve(torch.zeros(2, dtype=torch.float64), shared=shared)
    side = frames * n
    border = normal.border.reshape(2, side, m)
    if shared:
        whole = torch.zeros(2 * side + m, 2 * side + m, dtype=torch.float64)
        gradient = torch.cat([normal.gradient.flatten(), normal.corner_gradient.sum(0)])
        for v in range(2):
            own = slice(v * side, (v + 1) * side)
            whole[own, own] = dense[v]
            whole[own, 2 * side :] = border[v]
            whole[2 * side :, own] = border[v].T
        whole[2 * side :, 2 * side :] = normal.corner.sum(0)
        expected = -torch.linalg.solve(whole, gradient)
        assert torch.allclose(d_frames.flatten(), expected[: 2 * side], atol=1e-6)
        assert torch.allclose(d_globals[0], expected[2 * side :], atol=1e-6)
        assert torch.equal(d_globals[0], d_globals[1])
    else:
        for v in range(2):
            whole = torch.cat(
                [
                    torch.cat([dense[v], border[v]], 1),
                    torch.cat([border[v].T, normal.corner[v]], 1),
                ]
            )
            gradient = torch.cat([normal.gradient[v].flatten(), normal.corner_gradient[v]])
            expected = -torch.linalg.solve(whole, gradient)
            assert torch.allclose(d_frames[v].flatten(), expected[:side], atol=1e-6)
            assert torch.allclose(d_globals[v], expected[side:], atol=1e-6)
