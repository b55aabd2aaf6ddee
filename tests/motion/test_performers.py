"""Two performers of one action: a body shape for each, one motion for both."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from imocap_core.motion.motion_posterior import motion_posterior
from imocap_core.motion.multiview.low_rank import mean_shapes
from imocap_core.motion.multiview.scene import JointMotion
from imocap_core.motion.multiview.smpl_ba import recover_motion
from imocap_core.motion.posterior_noise import Noise
from imocap_core.motion.state import MotionState
from imocap_core.params import UncertaintyParams
from tests.motion.made import FOCAL_PX, K, Made, mpjpe_mm, scene
from tests.motion.test_smpl_ba import FRAMES, OPTIONS, disturbed, in_own_axes, whole

PERFORMERS = [0, 1, 0, 1]
LIMBS = [(1, 4), (4, 7), (16, 18), (18, 20)]  # thigh, shank, upper arm, forearm


@pytest.fixture(scope="module")
def made() -> Made:
    """Four views, two of either performer, whose bodies differ."""
    rng = np.random.default_rng(7)
    made = scene(FRAMES, [0.0, 80.0, -70.0, 170.0], rng)
    shapes = torch.as_tensor(0.7 * rng.standard_normal((2, 10)))
    own = in_own_axes(made)
    rest = made.body.model.joints_template[0]
    betas = shapes[PERFORMERS]
    moved = own.trans + rest - made.body.model.shape(betas).joints_rest[:, 0, None]
    state = replace(own, betas=betas, trans=moved)
    xyz = made.body.positions(made.body.keypoints, state).xyz.numpy()
    observations = []
    for x, observation, performer in zip(xyz, made.observations, PERFORMERS, strict=True):
        pixels = x[..., :2] / x[..., 2:] * FOCAL_PX + K[:2, 2]
        noisy = pixels + rng.normal(0, 1.0, pixels.shape)
        observations.append(replace(observation, xy_px=noisy, performer=performer))
    return replace(made, state=state, observations=observations)


def proportions(made: Made, betas: torch.Tensor) -> np.ndarray:
    """Logarithms of the limbs' lengths, relative to each other (M, 4)."""
    rest = made.body.model.shape(betas).joints_rest
    lengths = torch.stack([(rest[:, b] - rest[:, a]).norm(dim=-1) for a, b in LIMBS], dim=-1)
    logarithm = lengths.log().numpy()
    return np.asarray(logarithm - logarithm.mean(axis=1, keepdims=True))


def start_of(made: Made) -> MotionState:
    return disturbed(replace(made.state, betas=torch.zeros(4, 10).double()), 0.05)


@pytest.fixture(scope="module")
def declared(made: Made) -> JointMotion:
    return recover_motion(whole(made), start_of(made), OPTIONS)


def test_each_performer_has_one_shape_of_their_own(made: Made, declared: JointMotion) -> None:
    betas = declared.state.betas
    assert torch.equal(betas[0], betas[2])
    assert torch.equal(betas[1], betas[3])
    difference, true = (
        np.diff(proportions(made, b[:2]), axis=0)[0] for b in (betas, made.state.betas)
    )
    assert np.abs(difference - true).mean() < 0.3 * np.abs(true).mean()


def test_declared_performers_are_recovered_better_than_one_body(
    made: Made, declared: JointMotion
) -> None:
    one = replace(made, observations=[replace(o, performer=0) for o in made.observations])
    undeclared = recover_motion(whole(one), start_of(one), OPTIONS)
    assert torch.equal(undeclared.state.betas[0], undeclared.state.betas[1])
    errors = [mpjpe_mm(made.body, m.state, made.state) for m in (declared, undeclared)]
    assert errors[0] < 0.8 * errors[1]


def test_the_order_of_performers_does_not_count(made: Made, declared: JointMotion) -> None:
    others = [replace(o, performer=1 - o.performer) for o in made.observations]
    turned = recover_motion(whole(replace(made, observations=others)), start_of(made), OPTIONS)
    assert mpjpe_mm(made.body, turned.state, declared.state) < 3.0


def test_every_performer_s_uncertainty_is_finite(made: Made, declared: JointMotion) -> None:
    posterior = motion_posterior(whole(made), declared, OPTIONS, Noise(UncertaintyParams()))
    for covariance in posterior.covariances_m2:
        assert np.isfinite(covariance).all()


def test_mean_shapes_are_those_of_each_performer(made: Made) -> None:
    state = replace(made.state, betas=torch.arange(40.0).reshape(4, 10).double())
    means = mean_shapes(state, PERFORMERS)
    torch.testing.assert_close(means[0], state.betas[[0, 2]].mean(0))
    torch.testing.assert_close(means[1], state.betas[[1, 3]].mean(0))
