"""The block-banded solver against the dense matrix it stands for."""

from concurrent.futures import ThreadPoolExecutor

import pytest
import torch
from torch import Tensor

from imocap_core.motion.normal import NormalEquations, solve_globals, solve_pentadiagonal
from imocap_core.workers import on


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
    for v in range(2):
        found = solve_pentadiagonal(diagonal[v], next1[v], next2[v], right[v])
        expected = torch.linalg.solve(dense[v], right[v].reshape(-1, 3)).reshape(found.shape)
        assert torch.allclose(found, expected, atol=1e-10)


@pytest.mark.parametrize("shared", [False, True])
def test_border_is_eliminated_exactly(shared: bool) -> None:
    frames, n, m = 5, 3, 2
    diagonal, next1, next2, dense = banded(frames, n, accelerations=True)
    side, motions = frames * n, 2
    systems = []
    for v in range(motions):
        normal = NormalEquations.zeros(1, frames, n, m, diagonal)
        normal.diagonal, normal.next1, normal.next2 = (
            x[v : v + 1] for x in (diagonal, next1, next2)
        )
        normal.gradient = torch.randn(1, frames, n, dtype=torch.float64)
        normal.border = torch.randn(1, frames, n, m, dtype=torch.float64)
        normal.corner = 200 * torch.eye(m, dtype=torch.float64)[None]
        normal.corner_gradient = torch.randn(1, m, dtype=torch.float64)
        systems.append(normal)
    groups = [[0, 1]] if shared else [[0], [1]]
    for group in groups:
        reduced = [systems[v].reduce(0.0) for v in group]
        d_globals = solve_globals(reduced, 0.0)
        size = len(group) * side
        whole = torch.zeros(size + m, size + m, dtype=torch.float64)
        gradient = torch.zeros(size + m, dtype=torch.float64)
        for k, v in enumerate(group):
            own = slice(k * side, (k + 1) * side)
            border = systems[v].border.reshape(side, m)
            whole[own, own], whole[own, size:], whole[size:, own] = dense[v], border, border.T
            whole[size:, size:] += systems[v].corner[0]
            gradient[own] = systems[v].gradient.flatten()
            gradient[size:] += systems[v].corner_gradient[0]
        expected = -torch.linalg.solve(whole, gradient)
        found = torch.cat([r.frames(d_globals[None]).flatten() for r in reduced])
        assert torch.allclose(found, expected[:size], atol=1e-6)
        assert torch.allclose(d_globals, expected[size:], atol=1e-6)


def test_a_matrix_that_is_not_positive_definite_gives_nan() -> None:
    diagonal, next1, next2, _ = banded(4, 3, accelerations=True)
    right = torch.ones(4, 3, 1).double()
    assert solve_pentadiagonal(diagonal[0], next1[0], next2[0], right).isfinite().all()
    diagonal[0, 2] -= 100 * torch.eye(3, dtype=torch.float64)
    assert solve_pentadiagonal(diagonal[0], next1[0], next2[0], right).isnan().all()


def test_halves_on_threads_give_the_same_bits() -> None:
    diagonal, next1, next2, _ = banded(9, 4, accelerations=True)
    right = torch.randn(9, 4, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    system = (diagonal[0], next1[0], next2[0], right)
    with ThreadPoolExecutor(2) as pool:
        assert torch.equal(solve_pentadiagonal(*system, on(pool)), solve_pentadiagonal(*system))


def test_the_system_given_is_left_as_it_was() -> None:
    diagonal, next1, next2, _ = banded(6, 3, accelerations=True)
    system = (diagonal[0], next1[0], next2[0], torch.ones(6, 3, 2).double())
    before = [x.clone() for x in system]
    solve_pentadiagonal(*system)
    assert all(torch.equal(a, b) for a, b in zip(before, system, strict=True))
