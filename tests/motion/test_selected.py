"""Selected inversion against the dense inverse it stands for."""

import pytest
import torch

from imocap_core.motion.solver.normal import solve_pentadiagonal
from imocap_core.motion.solver.selected import factorise
from tests.motion.test_normal import banded

N = 4


@pytest.mark.parametrize("frames", [1, 2, 3, 7])
@pytest.mark.parametrize("accelerations", [False, True])
def test_diagonal_blocks_are_those_of_the_dense_inverse(frames: int, accelerations: bool) -> None:
    diagonal, next1, next2, dense = banded(frames, N, accelerations=accelerations)
    for v in range(2):
        found = factorise(diagonal[v], next1[v], next2[v]).inverse_diagonal()
        inverse = torch.linalg.inv(dense[v]).reshape(frames, N, frames, N)
        expected = torch.stack([inverse[t, :, t] for t in range(frames)])
        assert torch.allclose(found, expected, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("frames", [1, 2, 3, 7])
def test_its_solution_is_the_solver_s(frames: int) -> None:
    diagonal, next1, next2, _ = banded(frames, N, accelerations=True)
    right = torch.randn(frames, N, 3, dtype=torch.float64)
    found = factorise(diagonal[0], next1[0], next2[0]).solve(right)
    assert torch.allclose(
        found, solve_pentadiagonal(diagonal[0], next1[0], next2[0], right), rtol=1e-6, atol=1e-9
    )


def test_more_evidence_never_widens_a_block() -> None:
    diagonal, next1, next2, _ = banded(6, N, accelerations=True)
    before = factorise(diagonal[0], next1[0], next2[0]).inverse_diagonal()
    seen = diagonal[0].clone()
    seen[3] += 5 * torch.eye(N, dtype=torch.float64)
    after = factorise(seen, next1[0], next2[0]).inverse_diagonal()
    drop = torch.linalg.eigvalsh(before - after)
    assert float(drop.min()) > -1e-10
    assert float(drop[3].min()) > 1e-3


def test_a_matrix_that_is_not_positive_definite_gives_nan() -> None:
    diagonal, next1, next2, _ = banded(4, 3, accelerations=True)
    diagonal[0, 2] -= 100 * torch.eye(3, dtype=torch.float64)
    assert factorise(diagonal[0], next1[0], next2[0]).inverse_diagonal().isnan().all()


def test_blocks_of_different_lengths_are_named() -> None:
    diagonal, next1, next2, _ = banded(4, 3, accelerations=True)
    with pytest.raises(ValueError, match=r"three arrays \(T, n, n\)"):
        factorise(diagonal[0], next1[0, 1:], next2[0])
