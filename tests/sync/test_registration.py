"""A motion explains the keypoints of its own pictures, from any side, and not those of another."""

from __future__ import annotations

import numpy as np
import pytest

from imocap_core.sync.screening.registration import (
    Keypoints2D,
    camera_directions,
    explained_by_others,
    registration_residual,
)

JOINTS, FRAMES = 12, 60


def motion_of(seed: int) -> np.ndarray:
    """Joints (T, J, 3) that wander smoothly, each in its own way."""
    rng = np.random.default_rng(seed)
    start, first, second = rng.normal(size=(3, JOINTS, 3))
    t = np.linspace(0.0, 1.0, FRAMES)[:, None, None]
    return start + first * np.sin(4 * t) + second * np.cos(5 * t)


def filmed(motion: np.ndarray, azimuth: float, step: int = 1) -> Keypoints2D:
    """Seen from some side by a camera that is near enough for perspective to matter a little."""
    c, s = np.cos(azimuth), np.sin(azimuth)
    turned = motion[::step] @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T
    xy = 900 * turned[..., :2] / (turned[..., 2:] + 30.0) + 300
    return Keypoints2D(xy, np.ones(xy.shape[:2]))


@pytest.mark.parametrize("azimuth", [0.0, 1.0, 2.5, 4.0])
def test_a_motion_explains_its_pictures_from_any_side(azimuth: float) -> None:
    directions = camera_directions(256)
    same = registration_residual(motion_of(1), filmed(motion_of(1), azimuth, 2), directions)
    other = registration_residual(motion_of(2), filmed(motion_of(1), azimuth, 2), directions)
    assert same < 0.25
    assert other > 2 * same


def test_scale_place_and_missing_joints_do_not_matter() -> None:
    directions, film = camera_directions(), filmed(motion_of(1), 0.7)
    before = registration_residual(motion_of(1), film, directions)
    moved = Keypoints2D(3.0 * film.xy_px + 50.0, film.weight)
    assert registration_residual(motion_of(1), moved, directions) == pytest.approx(before)
    hidden = Keypoints2D(film.xy_px.copy(), film.weight.copy())
    hidden.xy_px[:, 3], hidden.weight[:, 3] = np.nan, 0.0
    assert registration_residual(motion_of(1), hidden, directions) < 1.5 * before


def test_directions_are_level_cameras() -> None:
    axes = camera_directions()
    np.testing.assert_allclose(
        np.einsum("dij,dkj->dik", axes, axes), [np.eye(2)] * len(axes), atol=1e-9
    )
    np.testing.assert_allclose(axes[:, 0, 1], 0.0, atol=1e-12)  # the horizon is level
    assert (axes[:, 1, 1] > 0).all()  # down is down


def test_a_wrong_fit_of_the_right_action_is_explained_and_a_stranger_is_not() -> None:
    films = [filmed(motion_of(1), a) for a in (0.0, 1.2, 2.4, 3.9)]
    motions = [motion_of(1)] * 3 + [motion_of(7)]  # the last video's fit went wrong
    assert explained_by_others(3, [0, 1, 2], motions, films)
    stranger = [*films[:3], filmed(motion_of(2), 0.5)]
    assert not explained_by_others(3, [0, 1, 2], motions, stranger)


def test_nothing_visible_explains_nothing() -> None:
    film = filmed(motion_of(1), 0.0)
    unseen = Keypoints2D(film.xy_px, np.zeros_like(film.weight))
    assert registration_residual(motion_of(1), unseen, camera_directions()) == 1.0
