"""A camera at a textured wall: turning and zooming are measured, standing still is exact, moving
is flagged."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.camera import background
from imocap_core.camera.averaging import angle_deg
from imocap_core.camera.background import (
    Matches,
    background_mask,
    chain,
    filled_boxes,
    overlap,
    rescaled,
    track_background,
)
from imocap_core.camera.camera_motion import estimate_camera_motion
from imocap_core.camera.projection import intrinsics, project_camera, warp
from imocap_core.camera.zooming import RotationsAndZooms, homographies, lens_of, rotations_and_zooms

SIZE, FOCAL = (320, 180), 280.0
K = intrinsics(FOCAL, SIZE)
WALL_SIZE = (1100, 600)
K_WALL = intrinsics(FOCAL, WALL_SIZE)


def wall(rng):
    """A texture with detail at all scales, as a picture of a camera that looks straight ahead."""
    width, height = WALL_SIZE
    layers = [
        cell**0.5
        * cv2.resize(rng.random((height // cell, width // cell)), WALL_SIZE, interpolation=2)
        for cell in (3, 6, 12, 24, 48)
    ]
    total = np.sum(layers, axis=0)
    return (255 * (total - total.min()) / np.ptp(total)).astype(np.uint8)


def view_of(wall_picture, H_frame_from_wall, rng, noise=2.0):
    picture = cv2.warpPerspective(wall_picture, H_frame_from_wall, SIZE, flags=cv2.INTER_CUBIC)
    return np.clip(picture + noise * rng.normal(size=picture.shape), 0, 255).astype(np.uint8)


def walker(t):
    """The box of a person who crosses the picture."""
    return np.array([60.0 + 3 * t, 40.0, 120.0 + 3 * t, 170.0])


def with_walker(picture, t):
    """Stripes that move with the person: features that would mislead."""
    x0, y0, x1, y1 = walker(t).astype(int)
    picture[y0:y1, x0:x1] = np.where((np.arange(x1 - x0) // 6) % 2, 220, 30)
    return picture


def turning_clip(R_frame_from_first, seed=0):
    rng = np.random.default_rng(seed)
    texture = wall(rng)
    homographies = K @ R_frame_from_first @ np.linalg.inv(K_WALL)
    pictures = [with_walker(view_of(texture, H, rng), t) for t, H in enumerate(homographies)]
    return pictures, np.stack([walker(t) for t in range(len(pictures))])


def look(pictures, boxes, focal_px=None):
    matches = track_background(pictures, boxes, max_features=200, min_inliers=20, threshold_px=1.5)
    estimate = estimate_camera_motion(
        matches, SIZE, focal_px, assumed_focal_factor=1.0, threshold_px=1.5
    )
    return estimate, matches


def pan(degrees, tilt=0.0, frames=40):
    """Rotations (T, 3, 3) frame from first: out to ``degrees``, beyond the overlap, and back."""
    share = np.sin(np.pi * np.linspace(0, 1, frames))
    angles = np.stack([degrees * share, tilt * share, 0.5 * share], axis=1)
    return Rotation.from_euler("yxz", angles, degrees=True).as_matrix()


def errors_deg(estimate, R_frame_from_first):
    return angle_deg(estimate.R_first_from_frame, np.swapaxes(R_frame_from_first, 1, 2))


@pytest.mark.parametrize(("degrees", "tilt"), [(2.0, 1.0), (12.0, 3.0), (32.0, 4.0)])
def test_rotations_are_within_a_tenth_of_a_degree_when_the_focal_length_is_given(degrees, tilt):
    R = pan(degrees, tilt)
    estimate, _ = look(*turning_clip(R), focal_px=FOCAL)
    assert estimate.motion == "rotating"
    assert estimate.focal_source == "given"
    assert np.median(errors_deg(estimate, R)) < 0.1
    assert errors_deg(estimate, R).max() < 0.3


def test_the_focal_length_is_solved_when_the_camera_turns_enough():
    R = pan(14.0, 5.0)
    estimate, _ = look(*turning_clip(R))
    assert estimate.focal_source == "rotation"
    assert abs(estimate.K[0, 0] / FOCAL - 1) < 0.04
    assert np.median(errors_deg(estimate, R)) < 0.3


def test_a_slight_turn_says_nothing_about_the_focal_length():
    estimate, _ = look(*turning_clip(pan(1.5)))
    assert estimate.motion == "rotating"
    assert estimate.focal_source == "assumed"
    assert estimate.K[0, 0] == max(SIZE)


def test_keypoints_of_a_fixed_point_stay_in_place_after_warping():
    R = pan(12.0, 3.0)
    estimate, _ = look(*turning_clip(R))
    spot = np.array([200.0, 90.0])
    in_frames = warp(K @ R @ np.linalg.inv(K), spot)
    back = warp(estimate.H_first_from_frame, in_frames)
    assert np.linalg.norm(back - spot, axis=1).max() < 0.5


def test_drift_is_gone_when_the_camera_comes_back():
    R = pan(32.0)
    estimate, matches = look(*turning_clip(R), focal_px=FOCAL)
    assert len({match.key for match in matches}) > 1
    assert matches[-1].key == 0
    assert errors_deg(estimate, R)[-3:].max() < 0.05


def test_a_camera_that_stands_still_is_exactly_still():
    estimate, _ = look(*turning_clip(np.tile(np.eye(3), (12, 1, 1))))
    assert estimate.motion == "static"
    assert np.array_equal(estimate.H_first_from_frame, np.tile(np.eye(3), (12, 1, 1)))
    assert np.array_equal(estimate.R_first_from_frame, np.tile(np.eye(3), (12, 1, 1)))


def test_a_camera_that_moves_past_a_near_and_a_far_wall_is_flagged():
    rng = np.random.default_rng(1)
    far, near = wall(rng), wall(rng)
    pictures = []
    for t in range(30):
        shift = np.array([[1.0, 0, -1.0 * t], [0, 1, 0], [0, 0, 1]])
        quick = np.array([[1.0, 0, -5.0 * t], [0, 1, 0], [0, 0, 1]])
        picture = view_of(far, shift, rng)
        picture[100:] = view_of(near, quick, rng)[100:]
        pictures.append(picture)
    estimate, _ = look(pictures, np.full((30, 4), np.nan))
    assert estimate.motion == "translating"
    assert estimate.focal_source == "assumed"
    assert "the camera moves" in estimate.note
    without_K = np.linalg.inv(estimate.K) @ estimate.H_first_from_frame @ estimate.K
    np.testing.assert_allclose(without_K, estimate.R_first_from_frame, atol=1e-9)  # no shear


def test_a_jump_is_found_again_by_its_features():
    R = pan(2.0, frames=12)
    jump = Rotation.from_euler("y", 13, degrees=True).as_matrix()
    R[6:] = jump @ R[6:]
    estimate, _ = look(*turning_clip(R), focal_px=FOCAL)
    assert (estimate.inliers > 0).all()
    assert errors_deg(estimate, R).max() < 0.3


@pytest.mark.parametrize("noise", [0.0, 12.0])
def test_a_plain_wall_cannot_be_followed_says_so_and_costs_little(monkeypatch, noise):
    rng = np.random.default_rng(2)
    far, costly = background._match_far, []
    monkeypatch.setattr(background, "_match_far", lambda *a: costly.append(a) or far(*a))
    plain = [np.clip(235 + noise * rng.normal(size=(180, 320)), 0, 255) for _ in range(20)]
    estimate, _ = look([picture.astype(np.uint8) for picture in plain], np.full((20, 4), np.nan))
    assert estimate.motion == "unknown"
    assert "too few features to track" in estimate.note
    assert len(costly) <= (11 if noise else 0)


def test_one_frame_is_a_clip():
    estimate, matches = look(*turning_clip(np.eye(3)[None]))
    assert len(matches) == 1
    assert estimate.motion == "static"


def test_smaller_pictures_give_the_same_answer_in_full_pixels():
    R = pan(8.0, 2.0)
    pictures, boxes = turning_clip(R)
    halves = [cv2.resize(p, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA) for p in pictures]
    small = track_background(
        halves, (boxes + 0.5) * 0.5 - 0.5, max_features=200, min_inliers=20, threshold_px=1.5
    )
    estimate = estimate_camera_motion(
        [rescaled(match, 0.5) for match in small],
        SIZE,
        FOCAL,
        assumed_focal_factor=1.0,
        threshold_px=3.0,
    )
    assert np.median(errors_deg(estimate, R)) < 0.1


def test_chained_homographies_compose():
    _, matches = look(*turning_clip(pan(32.0)))
    first = chain(matches, np.stack([match.H_key_from_frame for match in matches]))
    for t, match in enumerate(matches):
        home = np.eye(3) if match.key == 0 else first[match.key]
        assert np.allclose(first[t], home @ match.H_key_from_frame)


def test_overlap_is_the_share_of_the_picture():
    half = np.array([[1.0, 0, 160.0], [0, 1, 0], [0, 0, 1]])
    assert overlap(np.eye(3), (180, 320)) == 1.0
    assert overlap(half, (180, 320)) == pytest.approx(0.5, abs=0.05)
    assert overlap(np.linalg.inv(half), (180, 320)) == pytest.approx(0.5, abs=0.05)


def test_gaps_between_boxes_are_bridged_and_the_mask_covers_them():
    boxes = np.array([[10.0, 10, 20, 30], [np.nan] * 4, [30, 10, 40, 30]])
    assert filled_boxes(boxes)[1].tolist() == [20.0, 10.0, 30.0, 30.0]
    mask = background_mask((60, 80), filled_boxes(boxes)[1])
    assert (mask[10:31, 20:31] == 0).all()
    assert mask[50, 70] == 255
    assert (background_mask((60, 80), np.full(4, np.nan)) == 255).all()


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
