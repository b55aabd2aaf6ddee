"""Selected inversion against the dense inverse it stands for."""

import pytest
import torch
from torch import Tensor

from imocap_core.motion import selected_inversion
from imocap_core.motion.normal import solve_pentadiagonal
from imocap_core.motion.selected_inversion import InversePiece, selected_inverse
from tests.motion.test_normal import banded

N = 4


def blocks(
    diagonal: Tensor, next1: Tensor, next2: Tensor, held: int = selected_inversion.HELD
) -> Tensor:
    """(T, n, n) of the inverse."""
    pieces = [*selected_inverse(diagonal, next1, next2, held=held)]
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
    pieces: list[InversePiece] = [*selected_inverse(*system, held=held)][::-1]
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


def test_blocks_of_different_lengths_are_named() -> None:
    diagonal, next1, next2, _ = banded(4, 3, accelerations=True)
    with pytest.raises(ValueError, match=r"three arrays \(T, n, n\)"):
        blocks(diagonal[0], next1[0, 1:], next2[0])
