"""Focal lengths come back where the videos show one motion."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from imocap_core.motion.multiview.common_motion import unknowns_of
from imocap_core.motion.multiview.scene import JointMotion, Scene
from imocap_core.motion.multiview.smpl_ba import solve_jointly
from imocap_core.motion.multiview.timeline import make_timeline
from imocap_core.motion.state import MotionState
from imocap_core.params import MotionParams
from tests.motion.made import FOCAL_PX, FRAMES, WEIGHTS, Made, scene, wide_prior
from tests.motion.test_smpl_ba import OPTIONS, disturbed, in_own_axes

TURNS_DEG = [0.0, 75.0, -80.0, 170.0]
OFF = np.array([1.12, 0.9, 1.0, 0.86])  # of the true focal lengths
SPREAD = 0.15


@pytest.fixture(scope="module")
def made() -> Made:
    return scene(FRAMES, TURNS_DEG, np.random.default_rng(8), path_m=0.4)


def assumed(made: Made, spread: float) -> Scene:
    """Wrong focal lengths with a prior of this spread."""
    maps = [np.arange(float(FRAMES)) for _ in TURNS_DEG]
    trust = [np.ones(FRAMES) for _ in TURNS_DEG]
    seen = [
        replace(o, K=o.K @ np.diag([off, off, 1.0]), focal_spread=spread)
        for o, off in zip(made.observations, OFF, strict=True)
    ]
    timeline = make_timeline(maps, trust, FRAMES)
    return Scene(made.body, wide_prior(), seen, timeline, trust, 0, WEIGHTS)


def start_of(made: Made) -> MotionState:
    """The true motions in their own axes, each as far away as its focal length makes it look."""
    true = in_own_axes(made)
    far = torch.as_tensor(np.stack([np.ones(4), np.ones(4), OFF], axis=-1))
    rest = made.body.model.joints_template[0]
    state = replace(true, trans=(true.trans + rest) * far[:, None] - rest)
    return disturbed(state, 0.02)


def recovered(made: Made, spread: float, max_steps: int) -> JointMotion:
    options: MotionParams = replace(OPTIONS, max_steps=max_steps)
    return solve_jointly(assumed(made, spread), start_of(made), options)


def focal_errors(found: JointMotion) -> np.ndarray:
    return np.log(found.cameras.K[:, 0, 0].numpy() / FOCAL_PX)


@pytest.mark.long
def test_focal_lengths_come_back_and_the_middle_of_the_picture_stays(made: Made) -> None:
    found = recovered(made, 0.5, 12)
    before = np.log(OFF)
    errors = focal_errors(found)
    assert np.sqrt((errors**2).mean()) < 0.3 * np.sqrt((before**2).mean()), errors
    assert torch.equal(found.cameras.K[:, 0, 0], found.cameras.K[:, 1, 1])
    middle = np.stack([o.K[:, 2] for o in made.observations])
    np.testing.assert_array_equal(found.cameras.K[:, :, 2].numpy(), middle)


@pytest.mark.long
def test_known_focal_lengths_stay(made: Made) -> None:
    np.testing.assert_allclose(focal_errors(recovered(made, 0.0, 2)), np.log(OFF), atol=1e-12)


def test_the_focal_likelihood_counts_once_per_action(made: Made) -> None:
    all_ = assumed(made, SPREAD)
    some = replace(
        all_,
        observations=[
            replace(o, focal_spread=SPREAD if v in (1, 3) else 0.0)
            for v, o in enumerate(all_.observations)
        ],
    )
    free = unknowns_of(some, [])
    assert list(free.videos) == [1, 3]
    assert free.weight.tolist() == pytest.approx([FRAMES / SPREAD**2] * 2)


def test_the_prior_is_about_the_assumed_value_wherever_the_fit_is(made: Made) -> None:
    free = unknowns_of(assumed(made, SPREAD), [])
    state = replace(made.state, log_focal=torch.log(torch.as_tensor(OFF))[None])
    (prior,) = free.prior(made.cameras().K)
    assert float(prior.cost(state)) == pytest.approx(0.0, abs=1e-12)
    (elsewhere,) = free.prior(free.intrinsics(made.cameras().K, state.log_focal[0]))
    moved = replace(state, log_focal=state.log_focal + 0.1)
    still = replace(state, log_focal=torch.zeros_like(state.log_focal))
    assert float(elsewhere.cost(still)) == pytest.approx(0.0, abs=1e-12)
    assert float(prior.cost(moved)) == pytest.approx(FRAMES / SPREAD**2 * 4 * 0.1**2)
