"""Where the other videos have a video's limbs, and which detections they contradict."""

from dataclasses import replace

import numpy as np
import torch

from imocap_core.motion.multiview.repair import contradicted, expected_by_others
from imocap_core.motion.multiview.scene import Scene
from imocap_core.motion.multiview.timeline import make_timeline
from imocap_core.motion.state import MotionState
from imocap_core.rotations import exp
from tests.motion.made import FRAMES, Made
from tests.motion.test_smpl_ba import disturbed, in_own_axes, whole

VIDEO = 1


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
