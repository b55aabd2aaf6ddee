"""The shape prior: size is the direction in which all bones grow, and has its own weight."""

import torch

from imocap_core.body import load_free_body
from imocap_core.motion.terms.shape_prior import ShapePrior, size_direction

BODY = load_free_body()


def bone_sum(betas: torch.Tensor) -> torch.Tensor:
    joints = BODY.shape(betas).joints_rest
    parents = torch.as_tensor(BODY.parents[1:])
    return torch.linalg.vector_norm(joints[1:] - joints[parents], dim=-1).sum()


def test_no_other_direction_lengthens_the_bones_as_fast() -> None:
    size = size_direction(BODY)
    rate = torch.func.grad(bone_sum)(torch.zeros(10, dtype=BODY.dtype))
    torch.testing.assert_close(size, rate / rate.norm())


def test_size_and_proportions_have_their_own_weights() -> None:
    size = size_direction(BODY)
    prior = ShapePrior.of_body(BODY, 3.0, 50.0)
    other = torch.linalg.qr(torch.cat([size[:, None], torch.eye(10).to(size)], dim=1))[0][:, 1]
    assert torch.isclose(size @ prior.precision @ size, torch.tensor(50.0).to(size))
    assert torch.isclose(other @ prior.precision @ other, torch.tensor(3.0).to(size))
    assert torch.isclose(other @ prior.precision @ size, torch.tensor(0.0).to(size), atol=1e-9)
