"""What the other videos tell of a video's keypoints: predictions, and contradicted detections."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from imocap_core.motion.monocular.fit import (
    HIDDEN_LIMBS,
    Prediction,
    hidden_points,
    predicted_limbs,
    stretches,
)
from imocap_core.motion.multiview.leave_one_out import (
    motion_of_others,
    points_at_video_frames,
    predicted_by_others,
    resected_prediction,
)
from imocap_core.motion.multiview.repair import contradicted, expected_by_others
from imocap_core.motion.multiview.scene import DeviationSpread, JointMotion, Scene
from imocap_core.motion.multiview.timeline import make_timeline
from imocap_core.motion.state import MotionState
from imocap_core.params import MotionParams
from imocap_core.rotations import exp
from tests.motion.made import FRAMES, TURNS_DEG, Made
from tests.motion.test_smpl_ba import disturbed, in_own_axes, whole

VIDEO = 1


def solution(made: Made) -> JointMotion:
    """The truth, as the solver would return it."""
    shape = (len(TURNS_DEG), FRAMES, len(made.body.keypoints.names))
    spread = DeviationSpread(np.full(shape, 0.01), np.full((len(TURNS_DEG), 6), 0.01))
    return JointMotion(in_own_axes(made), made.cameras(), made.state, spread, [], "made", 0.0)


def with_other_arm(plain: Scene, made: Made, video: int) -> Scene:
    """A video in which the left hand is seen half a person's height away."""
    observations = list(plain.observations)
    o = observations[video]
    xy = o.xy_px.copy()
    wrist = made.body.keypoints.names.index("left_wrist")
    xy[:, wrist, 0] += 0.5 * o.size_px
    observations[video] = replace(o, xy_px=xy)
    return replace(plain, observations=observations)


def test_one_motion_is_predicted_by_the_other_views(made: Made) -> None:
    plain = whole(made)
    for prediction in predicted_by_others(plain, solution(made), MotionParams()):
        assert 0.001 < prediction.median < 0.02  # noise of one pixel, a person of some 250
        assert prediction.near_share > 0.98
        assert prediction.frames == FRAMES // 2


def test_what_a_video_shows_alone_is_not_predicted(made: Made) -> None:
    plain = with_other_arm(whole(made), made, VIDEO)
    wrist = made.body.keypoints.names.index("left_wrist")
    of_all = solution(made)
    others = motion_of_others(
        plain, made.state, made.cameras(), of_all.spread, VIDEO, MotionParams()
    )
    xyz_m = points_at_video_frames(plain, others, VIDEO)
    errors = resected_prediction(plain, xyz_m, made.cameras(), VIDEO, 0.0).error
    assert np.nanmedian(errors[:, wrist]) == pytest.approx(0.5, abs=0.05)
    rest = [k for k in range(errors.shape[1]) if k != wrist]
    assert np.nanmedian(errors[:, rest]) < 0.03


def test_another_time_is_predicted_worse(made: Made) -> None:
    plain = whole(made)
    xyz_m = points_at_video_frames(plain, made.state, VIDEO)
    rolled = np.roll(xyz_m, FRAMES // 3, axis=0)
    right, wrong = (
        resected_prediction(plain, x, made.cameras(), VIDEO, 0.0).median for x in (xyz_m, rolled)
    )
    assert wrong > 3 * right


def test_of_another_path_or_an_unknown_one_poses_alone_are_predicted(made: Made) -> None:
    plain = whole(made)
    xyz_m = points_at_video_frames(plain, made.state, VIDEO)
    observations, time = list(plain.observations), np.arange(FRAMES)[:, None, None]
    o = observations[VIDEO]
    observations[VIDEO] = replace(o, xy_px=(1 + 0.01 * time) * o.xy_px + 5.0 * time)
    moved = replace(plain, observations=observations)
    before = resected_prediction(plain, xyz_m, made.cameras(), VIDEO, 0.0).median
    on_one_spot = resected_prediction(moved, xyz_m, made.cameras(), VIDEO, 0.0).median
    elsewhere = resected_prediction(moved, xyz_m, made.cameras(), VIDEO, 0.1).median
    observations[VIDEO] = replace(observations[VIDEO], place_sd_m=np.ones(FRAMES))
    unknown = resected_prediction(moved, xyz_m, made.cameras(), VIDEO, 0.0).median
    assert elsewhere == unknown < 3 * before < on_one_spot


def test_a_limb_that_is_hidden_is_compared_and_nothing_else(made: Made) -> None:
    plain = whole(made)
    limb = stretches(FRAMES, 30.0) % len(HIDDEN_LIMBS)
    given = plain.body, plain.prior, plain.observations, in_own_axes(made), plain.fit
    for prediction in predicted_limbs(*given):
        assert ((prediction.weight > 0) == hidden_points(made.body.keypoints, limb)).all()
        assert 0.0 < prediction.median < 0.15
    names = np.array(made.body.keypoints.names)
    hidden = hidden_points(made.body.keypoints, np.array([0]))[0]
    assert {"left_elbow", "left_wrist"} == set(names[hidden])


def test_median_and_share_are_weighted() -> None:
    prediction = Prediction(np.array([[0.01, 0.05, 0.2, np.nan]]), np.array([[1.0, 1, 3, 0]]))
    assert prediction.median == 0.2
    assert prediction.near_share == 0.4
    empty = Prediction(np.full((3, 2), np.nan), np.zeros((3, 2)))
    assert np.isnan(empty.median)
    assert np.isnan(empty.near_share)
    assert empty.frames == 0


def test_short_videos_have_stretches_to_predict() -> None:
    assert stretches(8, 30.0).tolist() == [0, 0, 1, 1, 2, 2, 3, 3]
    assert len(set(stretches(60, 30.0))) == 4


def with_bent_arm(state: MotionState, video: int) -> MotionState:
    """One video's left elbow bent by a right angle."""
    R_local = state.R_local.clone()
    bend = exp(torch.tensor([0.0, np.pi / 2, 0.0], dtype=torch.float64))
    R_local[video, :, 18] = R_local[video, :, 18] @ bend
    return replace(state, R_local=R_local)


def column(made: Made, name: str) -> int:
    return made.body.keypoints.names.index(name)


def test_one_motion_is_expected_where_it_is_detected(made: Made) -> None:
    plain = whole(made)
    for o, of_others in zip(
        plain.observations,
        expected_by_others(plain, in_own_axes(made), made.cameras()),
        strict=True,
    ):
        away = np.linalg.norm(o.xy_px - of_others.xy_px, axis=-1)
        assert away.max() < 6.0  # noise of one pixel
        assert not contradicted(o, of_others, made.body.keypoints.names).any()


def test_the_video_itself_has_no_say_in_its_limbs(made: Made) -> None:
    plain, motion = whole(made), in_own_axes(made)
    bent = expected_by_others(plain, with_bent_arm(motion, VIDEO), made.cameras())[VIDEO]
    straight = expected_by_others(plain, motion, made.cameras())[VIDEO]
    wrist = column(made, "left_wrist")
    moved = np.linalg.norm(bent.xy_px[:, wrist] - straight.xy_px[:, wrist], axis=-1)
    # the middle of its keypoints moves with its hand, a little
    assert np.median(moved) < 0.05 * np.median(plain.observations[VIDEO].size_px)


def test_a_doubtful_limb_detected_elsewhere_is_contradicted_and_no_other(made: Made) -> None:
    plain, motion = whole(made), disturbed(in_own_axes(made), 0.01)
    observations, wrist = list(plain.observations), column(made, "left_wrist")
    xy_px = observations[VIDEO].xy_px.copy()
    xy_px[5:9, wrist] += 0.4 * np.median(observations[VIDEO].size_px)
    confidence = observations[VIDEO].confidence.copy()
    confidence[5:8, wrist] = 0.4  # in the last of the four frames the detector is sure
    observations[VIDEO] = replace(observations[VIDEO], xy_px=xy_px, confidence=confidence)
    given = replace(plain, observations=observations)
    for v, (o, of_others) in enumerate(
        zip(observations, expected_by_others(given, motion, made.cameras()), strict=True)
    ):
        wrong = np.argwhere(contradicted(o, of_others, made.body.keypoints.names))
        assert wrong.tolist() == ([[f, wrist] for f in range(5, 8)] if v == VIDEO else [])


def test_where_the_others_disagree_they_contradict_less(made: Made) -> None:
    plain, motion = whole(made), in_own_axes(made)
    alike = expected_by_others(plain, motion, made.cameras())[VIDEO]
    apart = expected_by_others(plain, with_bent_arm(motion, 2), made.cameras())[VIDEO]
    wrist, knee = column(made, "left_wrist"), column(made, "left_knee")
    assert (apart.limit_px[:, wrist] > 2 * alike.limit_px[:, wrist]).all()
    assert (apart.limit_px[:, knee] < 1.5 * alike.limit_px[:, knee]).all()


def test_a_moment_that_one_other_video_shows_says_nothing(made: Made) -> None:
    maps = [np.arange(float(FRAMES)) for _ in made.observations]
    for m in maps[2:]:
        m[10:] = np.nan
    trust = [np.isfinite(m).astype(float) for m in maps]
    timeline = make_timeline(maps, trust, FRAMES)
    plain: Scene = replace(whole(made), timeline=timeline, confidences=trust)
    of_others = expected_by_others(plain, in_own_axes(made), made.cameras())[VIDEO]
    assert np.isfinite(of_others.xy_px[:10]).all()
    assert np.isnan(of_others.xy_px[11:]).all()
