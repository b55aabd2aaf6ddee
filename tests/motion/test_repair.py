"""Left and right that the detector swapped for a while are put right by the other videos."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from imocap_core.conventions import mirror_indices
from imocap_core.motion.multiview.repair import (
    LEGS,
    WHOLE,
    point_shares,
    swapped,
    turning_frames,
    with_sides_of_others,
)
from imocap_core.motion.multiview.scene import Cameras, Scene
from imocap_core.motion.multiview.smpl_ba import solve_jointly
from imocap_core.motion.multiview.timeline import Timeline
from imocap_core.motion.state import MotionState
from imocap_core.rotations import exp
from tests.motion.made import FRAMES, TURNS_DEG, Made, mpjpe_mm
from tests.motion.test_smpl_ba import OPTIONS, disturbed, in_own_axes, whole

VIDEO = 0  # filmed from in front, where left and right lie far apart
STRETCH = np.arange(FRAMES) // 8 == 1  # frames 8 to 15


def confused(scene: Scene, state: int = WHOLE) -> Scene:
    """The scene whose detector swapped the sides of one video, or its legs, for a while."""
    observations = list(scene.observations)
    states = np.where(STRETCH, state, 0)
    hit = swapped(observations[VIDEO], states, scene.body.keypoints.names)
    observations[VIDEO] = replace(hit, swapped=None)
    return replace(scene, observations=observations)


def same_observations(a: Scene, b: Scene) -> None:
    for one, other in zip(a.observations, b.observations, strict=True):
        np.testing.assert_array_equal(one.xy_px, other.xy_px)
        np.testing.assert_array_equal(one.confidence, other.confidence)


def test_every_twin_has_its_twin_in_its_own_layout() -> None:
    names = ("nose", "left_knee", "right_knee", "nose", "right_knee", "left_knee")
    assert mirror_indices(names) == (0, 2, 1, 3, 5, 4)


@pytest.mark.parametrize("state", [LEGS, WHOLE])
def test_the_swapped_stretch_is_put_right_and_nothing_else(made: Made, state: int) -> None:
    motion, plain = disturbed(in_own_axes(made), 0.03), whole(made)
    put_right = with_sides_of_others(confused(plain, state), motion, made.cameras())
    same_observations(put_right, plain)


def test_what_was_swapped_by_mistake_before_is_put_back(made: Made) -> None:
    """The detector swapped the legs; before the joint motion, all the sides were swapped."""
    motion, plain = disturbed(in_own_axes(made), 0.03), whole(made)
    given = confused(confused(plain, LEGS), WHOLE)
    observations = list(given.observations)
    observations[VIDEO] = replace(observations[VIDEO], swapped=np.where(STRETCH, WHOLE, 0))
    put_right = with_sides_of_others(
        replace(given, observations=observations), motion, made.cameras()
    )
    same_observations(put_right, plain)


def test_arms_that_were_swapped_rightly_before_stay_so(made: Made) -> None:
    """The detector swapped all above the hips, and the choice of motions put it right."""
    motion, plain = disturbed(in_own_axes(made), 0.03), whole(made)
    observations = list(plain.observations)
    observations[VIDEO] = replace(observations[VIDEO], swapped=np.where(STRETCH, WHOLE ^ LEGS, 0))
    given = replace(plain, observations=observations)
    same_observations(with_sides_of_others(given, motion, made.cameras()), plain)


def test_many_points_on_a_head_say_no_more_than_one() -> None:
    names = ("nose", "left_eye", "left_ear", "left_knee", "left_foot_index", "left_wrist")
    assert point_shares(names).tolist() == [1 / 3, 1 / 3, 1 / 3, 1, 1, 1]
    hands = ("left_thumb", "left_index", "right_thumb", "right_index", "left_hip")
    assert point_shares(hands).tolist() == [0.5] * 4 + [1]
    assert point_shares(("nose", "left_thumb", "left_hip")).tolist() == [1] * 3


def test_of_two_videos_neither_tells_whose_legs_are_swapped(made: Made) -> None:
    """Exact poses: those of the one other video would speak for swapped legs."""
    motion, scene = in_own_axes(made), confused(whole(made), LEGS)
    two = replace(
        scene,
        observations=scene.observations[:2],
        confidences=scene.confidences[:2],
        timeline=Timeline(
            scene.timeline.to_reference[:2],
            scene.timeline.from_reference[:2],
            scene.timeline.confidence[:2],
        ),
    )
    cameras = made.cameras()
    first = Cameras(cameras.R[:2], cameras.t[:2], cameras.K[:2])
    both = MotionState.of(motion.R_local[:2], motion.trans[:2], motion.betas[:2], motion.valid[:2])
    same_observations(with_sides_of_others(two, both, first), two)


@pytest.mark.parametrize(("turn_deg", "turns"), [(0, False), (90, True), (180, False)])
def test_only_a_body_turned_by_a_quarter_is_turning(turn_deg: float, turns: bool) -> None:
    others = np.random.default_rng(2).normal(size=(FRAMES, 12, 3))
    own = others @ Rotation.from_euler("y", turn_deg, degrees=True).as_matrix().T
    turning = turning_frames(own, others, STRETCH, 30.0)
    np.testing.assert_array_equal(turning, STRETCH if turns else False)


def test_a_performer_who_turns_away_keeps_the_sides(made: Made) -> None:
    state = disturbed(in_own_axes(made), 0.03)
    R_local = state.R_local.clone()
    half = torch.pi * torch.linspace(0, 1, FRAMES, dtype=torch.float64)
    around = exp(half[:, None] * torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64))
    R_local[VIDEO, :, 0] = around @ R_local[VIDEO, :, 0]
    turned = replace(state, R_local=R_local)
    frames = np.ones(FRAMES, dtype=bool)
    poses = [made.body.positions(made.body.keypoints, s)[VIDEO].numpy() for s in (turned, state)]
    assert turning_frames(poses[0], poses[1], frames, 30.0).all()


@pytest.mark.long
def test_smpl_ba_with_swapped_sides_ends_like_the_undisturbed_one(made: Made) -> None:
    true = in_own_axes(made)
    start = disturbed(true, 0.03)
    good = solve_jointly(whole(made), start, OPTIONS)
    error_mm = mpjpe_mm(made.body, good.state, true)
    np.testing.assert_array_equal(good.swapped, np.zeros((len(TURNS_DEG), FRAMES)))
    for state in (LEGS, WHOLE):
        hit = solve_jointly(confused(whole(made), state), start, OPTIONS)
        assert mpjpe_mm(made.body, hit.state, true) < 1.05 * error_mm + 0.5
        np.testing.assert_array_equal(hit.swapped[VIDEO], np.where(STRETCH, state, 0))
