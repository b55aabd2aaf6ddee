"""Keypoints tell a mirrored video from one whose monocular fit reversed depth."""

from __future__ import annotations

import numpy as np
import pytest

from imocap_core.sync.screening.messages import sentences
from imocap_core.sync.screening.mirror import mirrored_poses
from imocap_core.sync.screening.mirrored_keypoints import (
    CLEAR_KEYPOINT_MARGIN,
    LEAST_KEYPOINT_MARGIN,
    judged_by_keypoints,
    keypoint_margin,
    reflected_keypoints,
)
from imocap_core.sync.screening.registration import Keypoints2D
from imocap_core.sync.screening.screening import Screening
from tests.sync.test_registration import filmed, motion_of
from tests.sync.test_screening import TWINS

AZIMUTHS = (0.0, 1.2, 2.4, 3.9)
UNKNOWN = np.full(4, np.nan)
FREE = [False] * 4


def films(mirrored: tuple[int, ...] = ()) -> list[Keypoints2D]:
    """Four films of one asymmetric motion, some of them in a mirror."""
    plain = [filmed(motion_of(1), a) for a in AZIMUTHS]
    return [reflected_keypoints(k, TWINS) if v in mirrored else k for v, k in enumerate(plain)]


def motions(reversed_depth: tuple[int, ...] = ()) -> list[np.ndarray]:
    """Their fits; one that reversed depth is, rigidly aligned, the mirror image of the motion."""
    motion = motion_of(1)
    return [mirrored_poses(motion, TWINS) if v in reversed_depth else motion for v in range(4)]


def test_reflecting_keypoints_twice_changes_nothing() -> None:
    film = films()[1]
    twice = reflected_keypoints(reflected_keypoints(film, TWINS), TWINS)
    np.testing.assert_allclose(twice.xy_px, film.xy_px)
    np.testing.assert_array_equal(twice.weight, film.weight)


@pytest.mark.parametrize("video", [0, 2])
def test_the_margin_changes_its_sign_with_the_reflection(video: int) -> None:
    others = [v for v in range(4) if v != video]
    plain = keypoint_margin(video, others, motions(), films(), TWINS)
    reflected = keypoint_margin(video, others, motions(), films((video,)), TWINS)
    assert plain < -CLEAR_KEYPOINT_MARGIN
    assert reflected == pytest.approx(-plain)


def test_a_reversed_fit_is_not_mirrored_though_its_poses_are() -> None:
    judged = judged_by_keypoints([3], UNKNOWN, FREE, motions((3,)), films(), TWINS)
    assert judged[:2] == ([], [3])


def test_a_mirrored_video_stays_mirrored() -> None:
    judged = judged_by_keypoints([3], UNKNOWN, FREE, motions((3,)), films((3,)), TWINS)
    assert judged[:2] == ([3], [])


def test_a_mirrored_video_whose_fit_reversed_depth_is_found_by_its_keypoints() -> None:
    mirrored, refuted, margins = judged_by_keypoints(
        [], UNKNOWN, FREE, motions(), films((2,)), TWINS
    )
    assert (mirrored, refuted) == ([2], [])
    assert margins[2] > CLEAR_KEYPOINT_MARGIN


def test_nothing_is_mirrored_where_nothing_is_or_the_user_has_decided() -> None:
    assert judged_by_keypoints([], UNKNOWN, FREE, motions(), films(), TWINS)[:2] == ([], [])
    given = [False, True, False, False]
    assert judged_by_keypoints([], UNKNOWN, given, motions(), films((2,)), TWINS)[0] == []


def test_an_action_that_is_its_own_mirror_image_is_never_flipped_and_it_is_said() -> None:
    half = motion_of(4)
    symmetric = 0.5 * (half + mirrored_poses(half, TWINS))
    plain = [filmed(symmetric, a) for a in AZIMUTHS]
    margin = keypoint_margin(3, [0, 1, 2], [symmetric] * 4, plain, TWINS)
    assert abs(margin) < LEAST_KEYPOINT_MARGIN
    judged = judged_by_keypoints([3], UNKNOWN, FREE, [symmetric] * 4, plain, TWINS)
    assert judged[:2] == ([], [3])
    screening = Screening((), (), (), (), UNKNOWN, UNKNOWN, refuted=(3,))
    assert "left as it is" in sentences(screening, "abcd")[0]
