"""A camera that zooms while it turns: both are measured, and one that only turns does not zoom."""

import numpy as np
import pytest

from imocap_core.camera.averaging import angle_deg
from imocap_core.camera.background import Matches
from imocap_core.camera.projection import project_camera, warp
from imocap_core.camera.zooming import RotationsAndZooms, homographies, lens_of, rotations_and_zooms
from tests.camera.test_camera_motion import (
    FOCAL,
    K_WALL,
    K,
    errors_deg,
    look,
    pan,
    turning_clip,
    view_of,
    walker,
    wall,
    with_walker,
)


def zooming_clip(R_frame_from_first, zoom):
    rng = np.random.default_rng(3)
    texture = wall(rng)
    lenses = lens_of(K, zoom)
    pictures = [
        with_walker(view_of(texture, lens @ R @ np.linalg.inv(K_WALL), rng), t)
        for t, (lens, R) in enumerate(zip(lenses, R_frame_from_first, strict=True))
    ]
    return pictures, np.stack([walker(t) for t in range(len(pictures))])


@pytest.mark.parametrize("most", [1.6, 0.75])
def test_a_camera_that_zooms_while_it_turns_is_followed(most):
    R = pan(10.0, 3.0)
    zoom = np.exp(np.log(most) * np.sin(np.linspace(0, np.pi, len(R))))
    estimate, _ = look(*zooming_clip(R, zoom), focal_px=FOCAL)
    assert estimate.motion == "zooming"
    assert "zooms from" in estimate.note
    np.testing.assert_allclose(estimate.zoom, zoom, rtol=0.01)
    assert errors_deg(estimate, R).max() < 0.4
    spot = np.array([180.0, 80.0])
    in_frames = warp(lens_of(K, zoom) @ R @ np.linalg.inv(K), spot)
    assert np.linalg.norm(warp(estimate.H_first_from_frame, in_frames) - spot, axis=1).max() < 1.0


def test_a_camera_that_only_turns_does_not_zoom():
    estimate, _ = look(*turning_clip(pan(12.0)), focal_px=FOCAL)
    assert estimate.motion == "rotating"
    assert np.array_equal(estimate.zoom, np.ones(len(estimate.zoom)))


def test_a_point_is_seen_where_its_place_in_the_first_frame_is_warped_to():
    R, zoom = pan(9.0, 2.0, frames=4).swapaxes(1, 2), np.array([1.0, 1.2, 1.5, 0.9])
    H = homographies(K, RotationsAndZooms(R, zoom))
    x_first = np.array([[0.3, -0.2, 4.0], [-0.6, 0.4, 3.0]])
    there = warp(np.linalg.inv(H)[:, None], project_camera(x_first, K)[None])
    for t, lens in enumerate(lens_of(K, zoom)):
        np.testing.assert_allclose(project_camera(x_first @ R[t], lens), there[t], atol=1e-9)


def test_zoom_and_turn_are_exact_on_exact_matches():
    rng = np.random.default_rng(0)
    R, zoom = pan(9.0, 2.0, frames=4), np.array([1.0, 1.2, 1.5, 0.9])
    H = K @ R.swapaxes(1, 2) @ np.linalg.inv(lens_of(K, zoom))  # first from frame
    matches = []
    for t, key in enumerate([0, 0, 1, 2]):
        xy = rng.uniform([40, 30], [280, 150], (60, 2))
        relative = np.linalg.inv(H[key]) @ H[t]
        matches.append(Matches(key, relative, warp(relative, xy), xy, np.ones(60, bool)))
    estimate = rotations_and_zooms(matches, K)
    np.testing.assert_allclose(estimate.zoom, zoom, rtol=1e-3)
    assert float(angle_deg(estimate.R, R.swapaxes(1, 2)).max()) < 0.02
    np.testing.assert_allclose(
        warp(homographies(K, estimate)[:, None], np.array([[150.0, 90.0]])),
        warp(H[:, None], np.array([[150.0, 90.0]])), atol=0.1,
    )  # fmt: skip
