"""The shape prior: what keypoints do not tell of a shape has its own weight."""

import torch

from imocap_core.body import load_free_body
from imocap_core.motion.terms.shape_prior import (
    ShapePrior,
    hidden_directions,
    length_rates,
    size_direction,
)

BODY = load_free_body()


def bone_sum(betas: torch.Tensor) -> torch.Tensor:
    joints = BODY.shape(betas).joints_rest
    parents = torch.as_tensor(BODY.parents[1:])
    return torch.linalg.vector_norm(joints[1:] - joints[parents], dim=-1).sum()


def test_no_other_direction_lengthens_the_bones_as_fast() -> None:
    size = size_direction(BODY)
    rate = torch.func.grad(bone_sum)(torch.zeros(10, dtype=BODY.dtype))
    torch.testing.assert_close(size, rate / rate.norm())


def test_what_keypoints_do_not_tell_has_its_own_weight() -> None:
    hidden = hidden_directions(BODY)
    prior = ShapePrior.of_body(BODY, 3.0, 50.0)
    identity = torch.eye(hidden.shape[1]).to(hidden)
    torch.testing.assert_close(hidden.T @ hidden, identity)
    torch.testing.assert_close(hidden.T @ prior.precision @ hidden, 50.0 * identity)
    told = torch.linalg.eigvalsh(prior.precision)[: 10 - hidden.shape[1]]
    torch.testing.assert_close(told, torch.full_like(told, 3.0))


def test_hidden_shape_is_size_and_what_leaves_the_lengths_as_they_are() -> None:
    size, rates = size_direction(BODY), length_rates(BODY)
    hidden = hidden_directions(BODY)
    torch.testing.assert_close(hidden @ (hidden.T @ size), size)
    assert hidden.shape == (10, 4)
    assert torch.linalg.matrix_rank(rates, rtol=1e-6) == 7
    assert torch.linalg.matrix_rank(rates @ hidden, rtol=1e-6) == 1  # of size alone


def test_length_rates_are_the_derivatives_of_lengths() -> None:
    def thigh(betas: torch.Tensor) -> torch.Tensor:
        joints = BODY.shape(betas).joints_rest
        sides = [joints[a] - joints[b] for a, b in ((4, 1), (5, 2))]
        return torch.stack([torch.linalg.vector_norm(bone) for bone in sides]).mean()

    slope = torch.func.grad(thigh)(torch.zeros(10, dtype=BODY.dtype))
    torch.testing.assert_close(length_rates(BODY)[0], slope)
