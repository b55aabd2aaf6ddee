"""The block-banded solver and selected inversion against the dense matrix they stand for."""

from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from imocap_core.motion import selected_inversion
from imocap_core.motion.normal import NormalEquations, solve_globals, solve_pentadiagonal
from imocap_core.motion.selected_inversion import InversePiece, selected_inverse

Solver = Callable[[Tensor, Tensor, Tensor, Tensor], Tensor]


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


def solved(diagonal: Tensor, next1: Tensor, next2: Tensor, right: Tensor) -> Tensor:
    """By LAPACK, as processors do it: the motions' frames of a system without damping."""
    system = NormalEquations.zeros(*right.shape[:3], right.shape[3] - 1, right)
    system.diagonal, system.next1, system.next2 = (x.clone() for x in (diagonal, next1, next2))
    system.gradient, system.border = right[..., 0], right[..., 1:]
    reduced = system.reduce(0.0, factored=False)
    return torch.cat([reduced.frame_only[..., None], reduced.response], -1)


@pytest.mark.parametrize("solve", [solved, solve_pentadiagonal])
@pytest.mark.parametrize("frames", [1, 2, 3, 6, 7])
@pytest.mark.parametrize("accelerations", [False, True])
def test_solution_is_the_dense_one(solve: Solver, frames: int, accelerations: bool) -> None:
    *blocks, dense = banded(frames, 4, accelerations=accelerations)
    right = torch.randn(2, frames, 4, 3, dtype=torch.float64)
    before = [x.clone() for x in blocks]
    found = solve(*blocks, right)
    expected = torch.linalg.solve(dense, right.reshape(2, -1, 3)).reshape(found.shape)
    assert torch.allclose(found, expected, atol=1e-8)
    assert all(torch.equal(a, b) for a, b in zip(before, blocks, strict=True))


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


@pytest.mark.parametrize("solve", [solved, solve_pentadiagonal])
def test_only_a_matrix_that_is_not_positive_definite_gives_nan(solve: Solver) -> None:
    *blocks, _ = banded(4, 3, accelerations=True)
    blocks[0][0, 2] -= 100 * torch.eye(3, dtype=torch.float64)
    found = solve(*blocks, torch.ones(2, 4, 3, 1).double())
    assert found[0].isnan().all()
    assert found[1].isfinite().all()


def test_a_system_reduced_in_place_gives_the_same_step_and_is_gone() -> None:
    *blocks, _ = banded(9, 4, accelerations=True)
    system = NormalEquations.zeros(2, 9, 4, 2, blocks[0])
    system.diagonal, system.next1, system.next2 = blocks
    system.gradient = torch.ones(2, 9, 4, dtype=torch.float64)
    expected, found = system.reduce(1e-3, factored=False), system.reduce(1e-3, in_place=True)
    growth = torch.ones(2, 2, dtype=torch.float64)
    assert torch.allclose(found.frames(growth), expected.frames(growth), rtol=1e-12, atol=1e-14)
    assert system.diagonal.numel() == system.next2.numel() == 0


N = 4


def blocks(diagonal: Tensor, next1: Tensor, next2: Tensor) -> Tensor:
    """(T, n, n) of the inverse."""
    pieces = [*selected_inverse(diagonal, next1, next2)]
    return torch.cat([piece.diagonal for piece in pieces[::-1]])


@pytest.mark.parametrize("frames", [1, 2, 3, 7])
@pytest.mark.parametrize("accelerations", [False, True])
def test_diagonal_blocks_are_those_of_the_dense_inverse(frames: int, accelerations: bool) -> None:
    diagonal, next1, next2, dense = banded(frames, N, accelerations=accelerations)
    for v in range(2):
        found = blocks(diagonal[v], next1[v], next2[v])
        inverse = torch.linalg.inv(dense[v]).reshape(frames, N, frames, N)
        expected = torch.stack([inverse[t, :, t] for t in range(frames)])
        assert torch.allclose(found, expected, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("frames", [1, 2, 3, 7])
def test_its_solution_is_the_solver_s(frames: int) -> None:
    *blocks, _ = banded(frames, N, accelerations=True)
    right = torch.randn(2, frames, N, 3, dtype=torch.float64)
    pieces = selected_inverse(*(x[0] for x in blocks), lambda t: right[0, t])
    found = torch.cat([piece.solution for piece in [*pieces][::-1]])
    assert torch.allclose(found, solve_pentadiagonal(*blocks, right)[0], rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("held", [1, 3, 5])
def test_repeated_elimination_changes_nothing(held: int, monkeypatch: pytest.MonkeyPatch) -> None:
    diagonal, next1, next2, _ = banded(11, N, accelerations=True)
    right = torch.randn(11, N, 2, dtype=torch.float64)
    system = diagonal[0], next1[0], next2[0], lambda t: right[t]
    (whole,) = selected_inverse(*system)
    monkeypatch.setattr(selected_inversion, "PIECE", 2)
    monkeypatch.setattr(selected_inversion, "HELD", held)
    pieces: list[InversePiece] = [*selected_inverse(*system)][::-1]
    assert [t for p in pieces for t in range(p.frames.start, p.frames.stop)] == [*range(11)]
    assert torch.equal(torch.cat([p.diagonal for p in pieces]), whole.diagonal)
    assert torch.equal(torch.cat([p.solution for p in pieces]), whole.solution)


def test_more_evidence_never_widens_a_block() -> None:
    diagonal, next1, next2, _ = banded(6, N, accelerations=True)
    before = blocks(diagonal[0], next1[0], next2[0])
    seen = diagonal[0].clone()
    seen[3] += 5 * torch.eye(N, dtype=torch.float64)
    after = blocks(seen, next1[0], next2[0])
    drop = torch.linalg.eigvalsh(before - after)
    assert float(drop.min()) > -1e-10
    assert float(drop[3].min()) > 1e-3


def test_a_matrix_that_is_not_positive_definite_gives_nan() -> None:
    diagonal, next1, next2, _ = banded(4, 3, accelerations=True)
    diagonal[0, 2] -= 100 * torch.eye(3, dtype=torch.float64)
    assert blocks(diagonal[0], next1[0], next2[0]).isnan().all()
