"""Laws of rotations: representations round-trip, also where their formulas are delicate."""

import math

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from imocap_core import rotations as so3

ANGLES_RAD = (0.0, 1e-12, 1e-7, 9e-3, 1.1e-2, 1.0, math.pi - 1e-3, math.pi - 1e-9, math.pi)


def axes(count: int = 30) -> torch.Tensor:
    """Random unit axes, and the awkward ones along the coordinate axes."""
    random = np.random.default_rng(0).normal(size=(count, 3))
    every = np.concatenate([random, np.eye(3), -np.eye(3)])
    return torch.as_tensor(every / np.linalg.norm(every, axis=1, keepdims=True))


def some_rotations(*leading: int, seed: int = 1) -> torch.Tensor:
    rng = np.random.default_rng(seed)
    count = math.prod(leading)
    return torch.as_tensor(Rotation.random(count, rng=rng).as_matrix().reshape(*leading, 3, 3))


@pytest.mark.parametrize("angle", ANGLES_RAD)
def test_exp_agrees_with_scipy(angle: float) -> None:
    expected = Rotation.from_rotvec((angle * axes()).numpy()).as_matrix()
    for exp in (so3.exp, torch.func.vmap(so3.exp)):
        np.testing.assert_allclose(exp(angle * axes()), expected, atol=1e-14)


@pytest.mark.parametrize("angle", ANGLES_RAD)
def test_log_undoes_exp(angle: float) -> None:
    matrix = so3.exp(angle * axes())
    back = so3.log(matrix)
    torch.testing.assert_close(so3.exp(back), matrix, atol=1e-14, rtol=0)
    torch.testing.assert_close(
        back.norm(dim=-1), torch.full((36,), angle, dtype=torch.float64), atol=1e-14, rtol=1e-12
    )


@pytest.mark.parametrize("angle", ANGLES_RAD)
def test_derivatives_of_exp_and_log_are_finite_and_right(angle: float) -> None:
    vector = (angle * axes()[0]).requires_grad_()
    jacobian = torch.autograd.functional.jacobian(so3.exp, vector)
    right = so3.right_jacobian(vector)
    generators = so3.hat(torch.eye(3, dtype=torch.float64)).movedim(0, -1)
    expected = torch.einsum("ab,bci,id->acd", so3.exp(vector), generators, right)
    torch.testing.assert_close(jacobian, expected.detach(), atol=1e-7, rtol=0)
    undone = so3.inverse_right_jacobian(vector) @ right
    torch.testing.assert_close(undone, torch.eye(3, dtype=torch.float64), atol=1e-12, rtol=0)
    there_and_back = torch.autograd.functional.jacobian(lambda v: so3.log(so3.exp(v)), vector)
    assert torch.isfinite(there_and_back).all()
    if angle < math.pi - 1e-6:
        torch.testing.assert_close(
            there_and_back, torch.eye(3, dtype=torch.float64), atol=1e-5, rtol=0
        )


def test_quaternions_are_scipys() -> None:
    matrix = torch.cat([some_rotations(200), so3.exp(math.pi * axes())])
    quaternion = so3.matrix_to_quaternion(matrix)
    scalar_last = Rotation.from_matrix(matrix.numpy()).as_quat(canonical=True)
    np.testing.assert_allclose(quaternion[:200], np.roll(scalar_last, 1, axis=1)[:200], atol=1e-14)


@pytest.mark.parametrize("angle", ANGLES_RAD)
def test_geodesic_angle_is_accurate_at_both_ends(angle: float) -> None:
    start = some_rotations(36)
    end = start @ so3.exp(angle * axes())
    assert (so3.geodesic_angle(start, end) - angle).abs().max() < 1e-14


def test_nearest_branch_is_the_same_rotation_and_the_nearest() -> None:
    rng = np.random.default_rng(2)
    vectors = torch.as_tensor(rng.normal(size=(200, 3)) * 2)
    reference = torch.as_tensor(rng.normal(size=(200, 3)) * 5)
    nearest = so3.nearest_branch(vectors, reference)
    torch.testing.assert_close(so3.exp(nearest), so3.exp(vectors), atol=1e-12, rtol=0)
    axis = vectors / vectors.norm(dim=-1, keepdim=True)
    for turn in (-3, -2, -1, 0, 1, 2, 3):
        other = vectors + 2 * math.pi * turn * axis
        nearer = (nearest - reference).norm(dim=-1) <= (other - reference).norm(dim=-1) + 1e-12
        assert nearer.all()


def test_the_identity_takes_the_branch_of_its_reference() -> None:
    reference = torch.tensor([[6.0, 0.0, 0.0]], dtype=torch.float64)
    nearest = so3.nearest_branch(torch.zeros_like(reference), reference)
    torch.testing.assert_close(nearest, torch.tensor([[2 * math.pi, 0.0, 0.0]]).double())


def test_unwrapped_paths_have_no_jumps() -> None:
    turning = torch.linspace(0, 9, 60, dtype=torch.float64)[:, None] * axes()[0]
    path = so3.unwrap(so3.log(so3.exp(turning)))
    torch.testing.assert_close(path, turning, atol=1e-12, rtol=0)


def test_mean_of_rotations() -> None:
    centre, spread = some_rotations(4), 0.3 * axes(10)[:16].reshape(4, 4, 3)
    pairs = torch.cat([centre[:, None] @ so3.exp(spread), centre[:, None] @ so3.exp(-spread)], 1)
    torch.testing.assert_close(so3.mean(pairs, dim=1), centre)  # symmetric about the centre
    torch.testing.assert_close(so3.mean(pairs, dim=-1), centre)
    weights = torch.zeros(4, 8, dtype=torch.float64)
    weights[:, 3] = 2.0
    torch.testing.assert_close(so3.mean(pairs, weights, dim=1), pairs[:, 3])
    nothing = so3.mean(pairs, torch.zeros(4, 8, dtype=torch.float64), dim=1)
    torch.testing.assert_close(nothing, torch.eye(3, dtype=torch.float64).expand(4, 3, 3))


def test_project_gives_the_nearest_rotation_even_to_reflections() -> None:
    rng = np.random.default_rng(3)
    matrix = torch.as_tensor(rng.normal(size=(50, 3, 3)))
    nearest = so3.project(matrix)
    torch.testing.assert_close(torch.linalg.det(nearest), torch.ones(50, dtype=torch.float64))
    distance = ((nearest - matrix) ** 2).sum((-2, -1))
    for seed in range(20):
        other = nearest @ so3.exp(0.1 * torch.as_tensor(np.random.default_rng(seed).normal(size=3)))
        assert (((other - matrix) ** 2).sum((-2, -1)) >= distance - 1e-12).all()
