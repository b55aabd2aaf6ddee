"""From videos' own frames to one axis: known phases are found again, ends hold, nothing falls."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from imocap_core.motion.multiview.scene import Scene
from imocap_core.motion.multiview.smpl_ba import Axis, continued, solve_jointly
from imocap_core.motion.multiview.timeline import (
    BeyondReference,
    common_grid,
    frame_positions,
    make_timeline,
    pose_at,
    values_at,
)
from imocap_core.motion.state import MotionState
from tests.motion.made import FRAMES, WEIGHTS, Made, mpjpe_mm, wide_prior
from tests.motion.test_smpl_ba import OPTIONS, disturbed, in_own_axes


def test_the_grid_spans_all_videos_in_steps_of_the_reference() -> None:
    phases = [np.array([0.0, 0.5, 1.0]), np.array([np.nan, -0.33, 1.21])]
    grid = common_grid(phases, fps=10.0)
    np.testing.assert_allclose(grid, np.arange(-3, 13) / 10, atol=1e-12)
    assert 0.0 in grid


def test_a_video_is_looked_up_where_its_phase_says() -> None:
    phase = np.array([0.0, 0.1, 0.4, 0.5])
    m = frame_positions(phase, np.array([-0.2, 0.0, 0.05, 0.25, 0.5, 0.6]))
    np.testing.assert_allclose(m.position, [0, 0, 0.5, 1.5, 3, 3], atol=1e-6)
    np.testing.assert_array_equal(m.inside, [False, True, True, True, True, False])


def test_own_frames_come_back_from_their_own_phases() -> None:
    rng = np.random.default_rng(0)
    phase = np.cumsum(rng.uniform(0.01, 0.1, 40))
    np.testing.assert_allclose(frame_positions(phase, phase).position, np.arange(40), atol=1e-5)


def test_a_rest_is_stepped_over_and_frames_without_phase_are_bridged() -> None:
    phase = np.array([0.0, 0.1, 0.1, 0.1, 0.2, np.nan, 0.4])
    m = frame_positions(phase, np.array([0.05, 0.15, 0.3]))
    np.testing.assert_allclose(m.position, [0.5, 3.5, 5.0], atol=1e-6)
    assert (np.diff(frame_positions(phase, np.linspace(0, 0.4, 50)).position) >= 0).all()


def test_phases_that_fall_are_refused() -> None:
    with pytest.raises(ValueError, match="phase_s: expected phases that never fall"):
        frame_positions(np.array([0.0, 0.2, 0.1]), np.zeros(1))


def test_poses_turn_evenly_between_frames_and_stay_on_one_branch() -> None:
    """A joint that turns at one speed does so on any axis, beyond half a turn too."""
    angle = np.linspace(0, 7.0, 30)
    theta = np.concatenate([np.outer(angle, [0, 0, 1]), np.outer(angle, [0.3, 0, 0])], axis=1)
    at = np.linspace(0, 29, 77)
    found = pose_at(theta, at)
    expected = 7.0 * at / 29
    np.testing.assert_allclose(found[:, 2], expected, atol=1e-9)
    np.testing.assert_allclose(found[:, 3], 0.3 * expected, atol=1e-9)
    assert np.abs(np.diff(found, axis=0)).max() < 0.3


def test_poses_at_whole_frames_are_the_poses() -> None:
    theta = Rotation.random(12, rng=1).as_rotvec().reshape(4, 9)
    back = Rotation.from_rotvec(pose_at(theta, np.arange(4.0)).reshape(-1, 3))
    assert (back.inv() * Rotation.from_rotvec(theta.reshape(-1, 3))).magnitude().max() < 1e-7


def test_values_are_linear() -> None:
    values = np.array([[0.0, 1.0], [2.0, 5.0], [4.0, 9.0]])
    np.testing.assert_allclose(values_at(values, np.array([0.0, 0.25, 2.0]))[:, 1], [1, 2, 9])
    np.testing.assert_array_equal(values_at(values[:1], np.zeros(2)), values[[0, 0]])


SHOWN = slice(6, 15)  # of all frames by the reference
BEFORE, AFTER = SHOWN.start, FRAMES - SHOWN.stop


def shorter(made: Made, confidence: float, others: tuple[int, ...] = (1, 2)) -> Scene:
    """A scene whose reference shows only a part; these others say so surely that they show the same
    moments beyond it."""
    position = np.arange(FRAMES) - float(BEFORE)
    count = SHOWN.stop - SHOWN.start
    inside = (position >= 0) & (position < count)
    maps = [np.arange(float(count)), *(np.where(inside, position, np.nan) for _ in range(2))]
    trust = [np.isfinite(m).astype(float) for m in maps]
    observations = list(made.observations)
    observations[0] = replace(
        observations[0],
        xy_px=observations[0].xy_px[SHOWN],
        confidence=observations[0].confidence[SHOWN],
    )
    none = BeyondReference(np.full(count, np.nan), np.zeros(count))
    beyond = [none] + [
        BeyondReference(np.where(inside, np.nan, position), (v in others) * confidence * ~inside)
        for v in (1, 2)
    ]
    timeline = make_timeline(maps, trust, count)
    return Scene(made.body, wide_prior(), observations, timeline, trust, 0, WEIGHTS, beyond)


def of_shorter(state: MotionState) -> MotionState:
    """A motion of all videos whose reference shows only a part."""
    R_local, trans, valid = state.R_local.clone(), state.trans.clone(), state.valid.clone()
    count = SHOWN.stop - SHOWN.start
    R_local[0, :count], trans[0, :count] = state.R_local[0, SHOWN], state.trans[0, SHOWN]
    valid[0, count:] = False
    return MotionState.of(R_local, trans, state.betas, valid)


def test_the_axis_is_continued_as_far_as_two_videos_reach(made: Made) -> None:
    longer, axis = continued(shorter(made, 0.8))
    assert axis == Axis(BEFORE, SHOWN.stop - SHOWN.start, AFTER)
    assert longer.timeline.from_reference.shape == (3, FRAMES)
    np.testing.assert_array_equal(
        longer.timeline.to_reference[0], np.arange(SHOWN.start, SHOWN.stop)
    )
    np.testing.assert_array_equal(longer.timeline.to_reference[1], np.arange(FRAMES))
    outside = [*range(SHOWN.start), *range(SHOWN.stop, FRAMES)]
    assert np.allclose(longer.confidences[1][outside], 0.8)
    assert np.allclose(longer.confidences[1][SHOWN], 1.0)
    assert np.allclose(longer.timeline.confidence[0][outside], 0.0)


@pytest.mark.parametrize(("confidence", "others"), [(0.0, (1, 2)), (0.8, (1,)), (0.8, ())])
def test_what_one_video_alone_shows_is_not_on_it(made, confidence, others):
    given = shorter(made, confidence, others)
    same, axis = continued(given)
    assert same is given
    assert axis.before == axis.after == 0


def test_a_video_that_is_nowhere_matched_has_no_place_beyond(made: Made) -> None:
    given = shorter(made, 0.8)
    given.timeline.to_reference[2][:] = np.nan
    assert continued(given)[1] == Axis(0, SHOWN.stop - SHOWN.start, 0)


@pytest.mark.long
def test_one_video_that_faces_the_wrong_way_there_is_turned_by_the_other(made: Made) -> None:
    """Before the reference begins the second video's motion has the back for the front."""
    truth = in_own_axes(made)
    start = disturbed(truth, 0.05)
    half_turn = torch.diag(torch.tensor([-1.0, 1.0, -1.0], dtype=torch.float64))
    start.R_local[1, : BEFORE - 1, 0] = half_turn @ start.R_local[1, : BEFORE - 1, 0]
    start, truth = of_shorter(start), of_shorter(truth)
    alone = solve_jointly(shorter(made, 0.0), start, replace(OPTIONS, max_steps=1))
    together = solve_jointly(shorter(made, 0.8), start, OPTIONS)
    count = SHOWN.stop - SHOWN.start
    assert together.common.R_local.shape[1] == together.spread.keypoints_m.shape[1] == count
    errors = []
    for found in (alone, together):
        early = [
            MotionState.of(s.R_local[1:2, :BEFORE], s.trans[1:2, :BEFORE], s.betas[1:2],
                           s.valid[1:2, :BEFORE])
            for s in (found.state, truth)
        ]  # fmt: skip
        errors.append(mpjpe_mm(made.body, *early))
    assert errors[0] > 100
    assert errors[1] < 30
