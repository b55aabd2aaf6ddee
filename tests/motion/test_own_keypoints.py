"""What a joint motion leaves of each video's own keypoints."""

from dataclasses import replace

import numpy as np
import pytest

from imocap_core.motion.multiview.repair import EXPLAINED_FLOOR, unexplained
from tests.motion.made import Made, scene
from tests.motion.test_smpl_ba import FRAMES, TURNS_DEG, disturbed, in_own_axes, whole


@pytest.fixture(scope="module")
def made() -> Made:
    return scene(FRAMES, TURNS_DEG, np.random.default_rng(5))


def test_the_true_motion_leaves_the_detector_s_noise_and_a_wrong_one_more(made: Made) -> None:
    truth = in_own_axes(made)
    left = [unexplained(whole(made), disturbed(truth, spread)) for spread in (0.0, 0.05, 0.15)]
    assert left[0] < np.log(
        4 * EXPLAINED_FLOOR
    )  # noise, and the perspective that a scale does not tell
    assert left[0] < left[1] < left[2]


def test_frames_without_a_match_and_unseen_points_do_not_count(made: Made) -> None:
    truth, matched = in_own_axes(made), whole(made, unmatched=6)
    spoiled = []
    for v, o in enumerate(matched.observations):
        xy_px, confidence = o.xy_px.copy(), o.confidence.copy()
        xy_px[:, 4] += 300.0
        confidence[:, 4] = 0.0
        if v:
            xy_px[-6:] += np.random.default_rng(v).normal(0, 50, xy_px[-6:].shape)
        spoiled.append(replace(o, xy_px=xy_px, confidence=confidence))
    pairs = zip(matched.observations, spoiled, strict=True)
    hidden = [replace(o, confidence=bad.confidence) for o, bad in pairs]
    plain = unexplained(replace(matched, observations=hidden), truth)
    assert unexplained(replace(matched, observations=spoiled), truth) == pytest.approx(plain)
