"""Who faces another way is released; whose fit took the back for the front is not."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from imocap_core.motion.multiview.common_motion import initial_offset_sd
from imocap_core.motion.multiview.per_video import (
    facing_agreement,
    fit_deviations,
    targets_of,
)
from imocap_core.motion.multiview.scene import DeviationSpread, Scene
from imocap_core.motion.multiview.smpl_ba import recover_motion
from imocap_core.motion.observations import Observation
from imocap_core.motion.state import MotionState
from imocap_core.params import MotionParams
from imocap_core.rotations import exp
from tests.motion.made import Made, mpjpe_mm, scene
from tests.motion.test_smpl_ba import FRAMES, OPTIONS, TURNS_DEG, disturbed, in_own_axes, whole

VIDEO = 1  # the one that turns, or whose fit went wrong


@pytest.fixture(scope="module")
def made() -> Made:
    return scene(FRAMES, TURNS_DEG, np.random.default_rng(5))


def turned(state: MotionState, angle_rad: float, since: int = 0) -> MotionState:
    """One video's root orientation turned about the body's vertical from a frame on."""
    R_local = state.R_local.clone()
    turn = exp(torch.tensor([0.0, angle_rad, 0.0]).double())
    R_local[VIDEO, since:, 0] = R_local[VIDEO, since:, 0] @ turn
    return replace(state, R_local=R_local)


def filming(scene: Scene, state: MotionState) -> Scene:
    """The same scene whose keypoints are those of other motions, in their cameras' axes."""
    xyz = scene.body.positions(scene.body.keypoints, state).xyz.numpy()

    def filmed(observation: Observation, x: np.ndarray) -> Observation:
        K = observation.K
        return replace(observation, xy_px=x[..., :2] / x[..., 2:] * K[0, 0] + K[:2, 2])

    rows = zip(scene.observations, xyz, strict=True)
    return replace(scene, observations=[filmed(o, x) for o, x in rows])


def weights(scene: Scene, made: Made, state: MotionState) -> Tensor:
    targets = targets_of(scene, state, made.state, made.cameras())
    return facing_agreement(scene, state, targets)


def test_who_turns_away_for_a_while_is_released_for_that_while(made: Made) -> None:
    performed = turned(in_own_axes(made), 1.5, since=8)
    alike = weights(filming(whole(made), performed), made, performed)
    torch.testing.assert_close(alike[[0, 2]], torch.ones(2, FRAMES, dtype=torch.float64))
    assert float(alike[VIDEO, :4].min()) > 0.99
    assert float(alike[VIDEO, 14:].max()) < 0.25


@pytest.mark.parametrize("angle_rad", [1.5, np.pi])
def test_a_wrong_root_orientation_that_the_keypoints_refute_is_not_released(
    made: Made, angle_rad: float
) -> None:
    wrong = turned(in_own_axes(made), angle_rad)
    alike = weights(whole(made), made, wrong)
    torch.testing.assert_close(alike, torch.ones_like(alike))


@pytest.mark.parametrize("afresh", [False, True])
def test_deviations_from_a_reversed_fit_end_like_those_from_a_good_one(
    made: Made, afresh: bool
) -> None:
    true = in_own_axes(made)
    spread = DeviationSpread(np.full((3, FRAMES, 25), 0.03), initial_offset_sd(3, MotionParams()))
    given = (made.state, made.cameras(), spread, replace(OPTIONS, max_steps=12))
    good, wrong = (
        fit_deviations(whole(made), state, *given, afresh=afresh)[0]
        for state in (true, turned(true, np.pi))
    )
    assert mpjpe_mm(made.body, wrong, good) < 2.0


@pytest.mark.parametrize("turns_deg", [[0.0, 80.0, -70.0, 160.0], [0.0, 80.0]])
def test_smpl_ba_from_one_reversed_view_ends_like_the_undisturbed_one(
    turns_deg: list[float],
) -> None:
    made = scene(FRAMES, turns_deg, np.random.default_rng(5))
    true = in_own_axes(made)
    start = disturbed(true, 0.03)
    good, wrong = (
        recover_motion(whole(made), state, OPTIONS).state for state in (start, turned(start, np.pi))
    )
    error_mm = mpjpe_mm(made.body, good, true)
    assert mpjpe_mm(made.body, wrong, true) < 1.05 * error_mm + 1.0
