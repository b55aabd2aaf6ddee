"""The shape prior: what keypoints do not tell of a shape has its own weight."""

import torch

from imocap_core.body import load_free_body
from imocap_core.motion.terms.body_priors import (
    ShapePrior,
    hidden_directions,
    length_rates,
    size_direction,
)

BODY = load_free_body()


def skeleton(betas: torch.Tensor) -> torch.Tensor:
    """Sum of all lengths between the twelve joints and of the trunk."""
    joints = BODY.shape(betas).joints_rest
    limbs = [(1, 4), (4, 7), (2, 5), (5, 8), (16, 18), (18, 20), (17, 19), (19, 21)]
    pairs = [(joints[a], joints[b]) for a, b in [*limbs, (1, 2), (16, 17)]]
    pairs.append((joints[[1, 2]].mean(0), joints[[16, 17]].mean(0)))
    return torch.stack([torch.linalg.vector_norm(a - b) for a, b in pairs]).sum()


def test_no_other_direction_makes_the_skeleton_of_the_twelve_joints_grow_as_fast() -> None:
    size = size_direction(BODY)
    rate = torch.func.grad(skeleton)(torch.zeros(10, dtype=BODY.dtype))
    torch.testing.assert_close(size, rate / rate.norm(), atol=2e-3, rtol=0)


def test_size_and_what_keypoints_do_not_tell_have_their_own_weights() -> None:
    hidden, size = hidden_directions(BODY), size_direction(BODY)
    prior = ShapePrior.of_body(BODY, 3.0, 50.0, 200.0)
    identity = torch.eye(hidden.shape[1]).to(hidden)
    torch.testing.assert_close(hidden.T @ hidden, identity)
    torch.testing.assert_close(hidden.T @ prior.precision @ hidden, 50.0 * identity)
    torch.testing.assert_close(prior.precision @ size, 200.0 * size)
    told = torch.linalg.eigvalsh(prior.precision)[: 9 - hidden.shape[1]]
    torch.testing.assert_close(told, torch.full_like(told, 3.0))


def test_hidden_shape_leaves_all_lengths_as_they_are() -> None:
    rates, hidden = length_rates(BODY), hidden_directions(BODY)
    assert hidden.shape == (10, 3)
    assert torch.linalg.matrix_rank(rates, rtol=1e-6) == 7
    torch.testing.assert_close(rates @ hidden, torch.zeros(7, 3).to(rates))


def test_people_told_to_be_wider_and_longer_in_the_leg_are_no_taller() -> None:
    """Where keypoints ask for other proportions, their sum stays that of the population."""
    rates = length_rates(BODY)
    asked = rates.new_tensor([0.03, 0.04, 0.02, 0.0, -0.07, -0.02, 0.02])  # metres
    prior = ShapePrior.of_body(BODY, 10.0, 100.0, 1000.0).precision
    # Proportions alone: what all lengths have in common is free, as it is for pictures.
    lengths = rates.new_tensor([0.39, 0.43, 0.26, 0.24, 0.17, 0.35, 0.47])
    free = torch.eye(7).to(rates) - torch.outer(lengths, lengths) / lengths.square().sum()
    told = rates.T @ free.T @ free @ rates * 1e7
    betas = torch.linalg.solve(told + prior, 1e7 * rates.T @ free.T @ free @ asked)
    grown = float(skeleton(betas) / skeleton(torch.zeros_like(betas)))
    assert abs(grown - 1) < 0.01
    torch.testing.assert_close(free @ rates @ betas, free @ asked, atol=2e-3, rtol=0)


def test_length_rates_are_the_derivatives_of_lengths() -> None:
    def thigh(betas: torch.Tensor) -> torch.Tensor:
        joints = BODY.shape(betas).joints_rest
        sides = [joints[a] - joints[b] for a, b in ((4, 1), (5, 2))]
        return torch.stack([torch.linalg.vector_norm(bone) for bone in sides]).mean()

    slope = torch.func.grad(thigh)(torch.zeros(10, dtype=BODY.dtype))
    torch.testing.assert_close(length_rates(BODY)[0], slope)
