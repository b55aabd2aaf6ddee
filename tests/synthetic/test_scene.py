"""Cameras turn about a fixed centre, and the pictures of a room obey them."""

import cv2
import numpy as np
import pytest

from imocap_core.camera.projection import project, warp
from imocap_core.synthetic.cameras import YOGA_CAMERAS, aim_camera, look_at
from imocap_core.synthetic.rooms import PX_PER_M, Surface, backdrop, cast_shadow, render_plate, room

SIZE = (320, 180)
PATH = np.stack([np.zeros(40), np.linspace(0, 0.4, 40), np.linspace(0.9, 0.2, 40)], axis=1)


def turning(seed: int = 0):
    return aim_camera(YOGA_CAMERAS[1], PATH, 30.0, SIZE, np.random.default_rng(seed))


def test_look_at_puts_its_target_in_the_middle_and_up_upwards():
    centre, target = np.array([1.0, -4.0, 1.5]), np.array([0.2, 0.1, 0.9])
    R = look_at(centre, target, 0.0, np.zeros(2))
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)
    np.testing.assert_allclose((R @ (target - centre))[:2], 0.0, atol=1e-12)
    assert (R @ [0, 0, 1.0])[1] < 0  # image y points down
    assert (R @ [0, 0, 1.0])[0] == pytest.approx(0.0, abs=1e-12)


def test_two_cameras_turn_and_two_stand_still():
    ranges = []
    for view in YOGA_CAMERAS:
        camera = aim_camera(view, PATH, 30.0, SIZE, np.random.default_rng(1))
        centres = -np.einsum("tji,tj->ti", camera.R_cam_from_world, camera.t)
        np.testing.assert_allclose(centres, np.broadcast_to(camera.centre, centres.shape))
        axis = camera.R_cam_from_world[:, 2]
        ranges.append(np.rad2deg(np.arccos(np.clip(axis @ axis[0], -1, 1)).max()))
    assert sorted(r > 3.0 for r in ranges) == [False, False, True, True]
    assert sorted(r < 1e-5 for r in ranges) == [False, False, True, True]


def test_viewpoints_are_far_apart_and_differ_in_focal_length_and_height():
    angles = np.array([view.azimuth_deg for view in YOGA_CAMERAS])
    apart = np.abs((angles[:, None] - angles[None] + 180) % 360 - 180)
    assert apart[~np.eye(4, dtype=bool)].min() > 60
    for field in ("focal_per_width", "height_m"):
        values = sorted(getattr(view, field) for view in YOGA_CAMERAS)
        assert (np.diff(values) > 0.05 * values[0]).all()


def test_the_performer_stays_in_the_picture(clips):
    for clip in clips:
        width, height = clip.size
        inside = (clip.xy_px > 4) & (clip.xy_px < (width - 5, height - 5))
        assert inside.all()
        tall = np.ptp(clip.xy_px[..., 1], axis=1).max()
        assert tall > 0.55 * height


def test_a_room_is_projected_where_geometry_says():
    """A red spot on a grey wall appears at the projection of its world point in every frame."""
    texture = np.full((600, 1200, 3), 40, np.uint8)
    cv2.circle(texture, (640, 330), 6, (255, 40, 40), -1, cv2.LINE_AA)
    up = np.array([0, 0, 1.0])
    camera = turning()
    facing = camera.R_cam_from_world[0][2] * (1, 1, 0)
    right = np.cross(facing / np.linalg.norm(facing), up)
    corner = 2.0 * facing - 640 / PX_PER_M * right + (0, 0, 1.0 + 330 / PX_PER_M)
    wall = Surface(texture, corner, right, -up)
    spot = corner + 640 / PX_PER_M * right - 330 / PX_PER_M * up
    plate = render_plate([wall], camera, SIZE)
    for frame in (0, 13, 39):
        R, t = camera.R_cam_from_world[frame], camera.t[frame]
        image = backdrop(plate, camera.K, R, SIZE).astype(float)
        weight = np.clip(image[..., 0] - image[..., 1] - 5, 0, None)
        rows, columns = np.mgrid[: SIZE[1], : SIZE[0]]
        spot_px = np.array([(weight * columns).sum(), (weight * rows).sum()]) / weight.sum()
        np.testing.assert_allclose(spot_px, project(spot, camera.K, R, t), atol=0.15)


def test_frames_of_a_turning_camera_are_homographies_of_each_other():
    camera = turning()
    plate = render_plate(room(0, 118.0, np.random.default_rng(0)), camera, SIZE)
    first, last = (
        backdrop(plate, camera.K, camera.R_cam_from_world[i], SIZE).astype(float) for i in (0, 39)
    )
    relative = camera.R_cam_from_world[0] @ camera.R_cam_from_world[39].T
    H = camera.K @ relative @ np.linalg.inv(camera.K)
    brought = cv2.warpPerspective(last, H, SIZE, borderValue=(-1, -1, -1))
    common = brought.min(axis=-1) >= 0
    assert common.mean() > 0.5
    assert np.abs(brought - first)[common].mean() < 9.0
    assert np.abs(last - first)[common].mean() > 25.0  # standing still would not do
    assert np.abs(warp(H, np.array([0.0, 0.0]))).max() > 5.0


@pytest.mark.long
def test_rooms_are_rich_in_features_different_and_seeded():
    fast = cv2.FastFeatureDetector_create(20)
    images = []
    for kind in range(4):
        camera = turning(kind)
        plate = render_plate(room(kind, 118.0, np.random.default_rng(kind)), camera, SIZE)
        assert len(fast.detect(cv2.cvtColor(plate.image, cv2.COLOR_RGB2GRAY))) > 300
        images.append(cv2.resize(plate.image, SIZE).astype(float))
    for a in range(4):
        for b in range(a):
            assert np.abs(images[a] - images[b]).mean() > 20
    again = render_plate(room(3, 118.0, np.random.default_rng(3)), turning(3), SIZE)
    assert (cv2.resize(again.image, SIZE) == images[3]).all()


def test_a_shadow_darkens_the_floor_below_and_nothing_far_away():
    camera = turning()
    R, t = camera.R_cam_from_world[0], camera.t[0]
    rng = np.random.default_rng(0)
    body = rng.uniform((-0.3, 0.0, 0.0), (0.3, 0.5, 0.2), (4000, 3))
    image = np.full((SIZE[1], SIZE[0], 3), 200, np.uint8)
    shaded = cast_shadow(image, body, camera.K, R, t)
    x, y = np.rint(project(np.array([0.0, 0.25, 0.0]), camera.K, R, t)).astype(int)
    assert shaded[y, x, 0] < 140
    assert (shaded[:20] == 200).all()
