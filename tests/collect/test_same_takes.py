"""A take that is shown again is told from another performance in front of the same camera."""

import cv2
import numpy as np
import pytest

from imocap_core.collect.same_takes import compared_pairs, repeated_motion, same_picture
from imocap_core.conventions import SMPL_JOINTS, mirror_indices
from tests.collect.made_tracks import FPS, movement, track

TWINS = mirror_indices(SMPL_JOINTS)
ORIGINAL = track(movement(1), noise_m=0.004)
BODY = 400.0  # pixels, about


@pytest.mark.parametrize("rate", [0.25, 0.5, 1.0, 2.0])
def test_a_take_at_another_speed_and_size_is_a_replay(rate: float) -> None:
    again = track(movement(1), shot=3, rate=rate, noise_m=0.004).xy_px * 0.8 + [40.0, -25.0]
    replay = repeated_motion(ORIGINAL.xy_px, again, FPS, TWINS)
    assert replay.rate == pytest.approx(1 / rate, rel=0.1)
    assert replay.scale == pytest.approx(1.25, rel=0.02)
    assert not replay.mirrored


def test_a_mirrored_take_is_a_replay() -> None:
    again = [640.0, 0.0] - ORIGINAL.xy_px[:, list(TWINS)] * [1.0, -1.0]
    replay = repeated_motion(ORIGINAL.xy_px, again, FPS, TWINS)
    assert replay.mirrored


def test_another_performance_before_the_same_camera_is_none() -> None:
    other = movement(1)
    rng = np.random.default_rng(5)
    other.c[-1] += rng.normal(0, 0.12, other.c[-1].shape)
    assert repeated_motion(ORIGINAL.xy_px, track(other).xy_px, FPS, TWINS) is None


def test_a_take_run_backwards_is_none() -> None:
    assert repeated_motion(ORIGINAL.xy_px, ORIGINAL.xy_px[::-1], FPS, TWINS) is None


def test_who_stands_still_repeats_nothing() -> None:
    still = np.repeat(ORIGINAL.xy_px[:1], 60, axis=0)
    assert repeated_motion(still, still, FPS, TWINS) is None


def test_pictures_are_compared_where_the_person_is() -> None:
    again = ORIGINAL.xy_px * 0.5 + [30.0, 10.0]
    replay = repeated_motion(ORIGINAL.xy_px, again, FPS, TWINS)
    pairs = compared_pairs(replay)
    assert all(a == b for a, b in pairs)
    texture = cv2.GaussianBlur(np.random.default_rng(0).random((480, 640)), (0, 0), 6)
    texture = cv2.normalize(texture, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    moved = cv2.warpAffine(texture, np.array([[0.5, 0, 30.0], [0, 0.5, 10.0]]), (640, 480))
    box = ORIGINAL.box_px[pairs[0][0]]
    assert same_picture(texture, moved, box, replay) > 0.95
    assert same_picture(texture, texture[::-1], box, replay) < 0.5
