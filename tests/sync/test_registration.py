"""A motion explains the keypoints of its own pictures, from any side, and not those of another."""

import numpy as np
import pytest

from imocap_core.sync.screening.explanation import explained_change, registered
from imocap_core.sync.screening.registration import (
    Keypoints2D,
    best_warp,
    camera_directions,
    centred_plane,
    reflected_keypoints,
    registration_residual,
    unbiased_directions,
)
from tests.sync import made_motions
from tests.sync.made_motions import view_of, wandering

JOINTS, FRAMES = 12, 60


def motion_of(seed: int) -> np.ndarray:
    return wandering(seed, JOINTS, FRAMES)


def filmed(motion: np.ndarray, azimuth: float, step: int = 1) -> Keypoints2D:
    return made_motions.filmed(view_of(motion[::step], azimuth))


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


def test_registration_finds_the_camera_the_warp_and_less_than_any_static_pose() -> None:
    film = filmed(motion_of(1), 0.9, 2)
    directions = unbiased_directions()
    view = registered(motion_of(1), film, directions)
    assert view.residual <= registration_residual(motion_of(1), film, directions)
    assert view.residual < 0.15
    assert view.static_residual > 3 * view.residual
    np.testing.assert_allclose(view.frames, np.arange(0, FRAMES, 2), atol=2)
    truth = np.array([[np.cos(0.9), 0.0, np.sin(0.9)], [0.0, 1.0, 0.0]])
    assert (np.sum(view.axes * truth, axis=1) > np.cos(np.deg2rad(10.0))).all()


@pytest.mark.parametrize("speed", [0.4, 0.5, 1.0, 2.0, 2.5])
def test_another_speed_costs_next_to_nothing_and_standing_still_does(speed: float) -> None:
    positions = np.arange(0, FRAMES - 1, speed)
    distance = np.abs(positions[:, None] - np.arange(FRAMES)) / 10
    cost, frames = best_warp(distance)
    assert (cost - distance[np.arange(len(frames)), frames].sum()) / len(frames) <= 0.021
    np.testing.assert_allclose(frames, positions, atol=1.0)
    still = best_warp(np.repeat(distance[:1], 40, axis=0))[0]
    assert still / 40 > 0.04


def test_explained_change_is_that_of_the_motion_whatever_is_wrong_throughout() -> None:
    film, rng = filmed(motion_of(1), 0.0), np.random.default_rng(1)
    plane, axes = centred_plane(film), np.eye(3)[:2]
    lasting = rng.normal(0, 0.5, (JOINTS, 3))

    def explained(motion: np.ndarray) -> float:
        return explained_change(motion @ axes.T, plane, film.weight)

    assert explained(motion_of(1)) > 0.98
    assert explained(motion_of(1) + lasting) > 0.8
    assert abs(explained(np.repeat(motion_of(1).mean(axis=0)[None], FRAMES, axis=0))) < 0.05
    assert explained(motion_of(2)) < 0.2
    garbled = motion_of(1)
    garbled[20:30] += rng.normal(0, 3.0, (10, JOINTS, 3))
    assert explained(garbled) > 0.7


def test_reflecting_keypoints_twice_changes_nothing() -> None:
    twins = [1, 0, 3, 2, 5, 4, 7, 6, 8, 9, 11, 10]
    film = filmed(motion_of(1), 1.2)
    twice = reflected_keypoints(reflected_keypoints(film, twins), twins)
    np.testing.assert_allclose(twice.xy_px, film.xy_px)
    np.testing.assert_array_equal(twice.weight, film.weight)


def test_nothing_visible_explains_nothing() -> None:
    film = filmed(motion_of(1), 0.0)
    unseen = Keypoints2D(film.xy_px, np.zeros_like(film.weight))
    assert registration_residual(motion_of(1), unseen, camera_directions()) == 1.0
