"""Cameras turn about a fixed centre, the pictures of a room obey them, and the simulated detector
has errors of the stated rates and sizes."""

import cv2
import numpy as np
import pytest

from imocap_core.camera.projection import project, warp
from imocap_core.conventions import OTHER, SMPL_JOINTS
from imocap_core.synthetic.cameras import YOGA_CAMERAS, aim_camera, look_at
from imocap_core.synthetic.detector import DetectorErrors, KeypointErrors, detect, false_people
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


NAMES = (
    "nose",
    "left_wrist",
    "right_wrist",
    "left_elbow",
    "right_elbow",
    "left_knee",
    "right_knee",
)
FRAMES = 4000


def still(height_px: float = 300.0):
    """A person who does not move: true keypoints (T, K, 2), heights (T,)."""
    figure = np.array([[50, 0], [0, 40], [100, 40], [20, 30], [80, 30], [40, 90], [60, 90.0]])
    return np.tile(figure, (FRAMES, 1, 1)), np.full(FRAMES, height_px)


def only(**kinds: object) -> DetectorErrors:
    quiet = {"noise": 1e-9, "outlier_rate": 0.0, "miss_rate": 0.0, "swap_rate": 0.0}
    return DetectorErrors(**(quiet | kinds))  # type: ignore[arg-type]


def test_noise_has_the_stated_size_and_half_of_it_persists():
    truth, height = still()
    errors = only(noise=4 / 600)
    detections = detect(truth, height, NAMES, 30.0, np.random.default_rng(0), errors)
    noise = detections.xy_px - truth
    assert noise.std() == pytest.approx(2.0, rel=0.15)
    lagged = (noise[3:] * noise[:-3]).mean() / (noise**2).mean()
    rho = np.exp(-1 / (errors.persistence_s * 30))
    assert lagged == pytest.approx(0.5 * rho**3, abs=0.06)


def test_noise_scales_with_the_person():
    errors = only(noise=4 / 600)
    sizes = []
    for height_px in (100.0, 400.0):
        truth, height = still(height_px)
        detections = detect(truth, height, NAMES, 30.0, np.random.default_rng(1), errors)
        sizes.append((detections.xy_px - truth).std())
    assert sizes[1] / sizes[0] == pytest.approx(4.0)


def test_misses_outliers_and_swaps_come_at_their_rates():
    truth, height = still()
    rng = np.random.default_rng(2)
    missed = detect(truth, height, NAMES, 30.0, rng, only(miss_rate=0.02))
    gone = missed.confidence == 0
    assert gone.mean() == pytest.approx(0.02, abs=0.004)
    assert (missed.xy_px[gone] == 0).all()
    outliers = detect(truth, height, NAMES, 30.0, rng, only(outlier_rate=0.02))
    assert (np.abs(outliers.xy_px - truth).max(axis=-1) > 1).mean() == pytest.approx(
        0.02, abs=0.004
    )
    swapped = detect(truth, height, NAMES, 30.0, rng, only(swap_rate=0.007)).xy_px
    arms = np.abs(swapped[:, 1] - truth[:, 2]).max(axis=-1) < 1
    assert 0.002 < arms.mean() < 0.016
    assert (np.abs(swapped[arms][:, 3] - truth[arms][:, 4]) < 1).all()  # the elbow goes along


def test_errors_by_kind_draw_no_random_numbers():
    """Detectors without them give the same detections: the protocol's inputs depend on it."""
    truth, height = still()
    plain = detect(truth, height, NAMES, 30.0, np.random.default_rng(5), only(noise=0.01))
    by_kind = {
        "wrist": KeypointErrors(),
        "knee": KeypointErrors(towards="ankle", share=0.5),
    }  # no ankle here
    named = only(noise=0.01, by_kind=by_kind)
    again = detect(truth, height, NAMES, 30.0, np.random.default_rng(5), named)
    assert (plain.xy_px == again.xy_px).all()
    assert (plain.confidence == again.confidence).all()


def test_keypoints_are_offset_towards_others():
    truth, height = still()
    by_kind = {
        "wrist": KeypointErrors(towards="elbow", share=0.25),
        "knee": KeypointErrors(0, 0, OTHER, 0.1),
    }
    marked = detect(
        truth, height, NAMES, 30.0, np.random.default_rng(6), only(by_kind=by_kind)
    ).xy_px
    assert marked[0, 1] == pytest.approx(0.75 * truth[0, 1] + 0.25 * truth[0, 3], abs=1e-4)
    assert marked[0, 5] == pytest.approx(truth[0, 5] + 0.1 * (truth[0, 6] - truth[0, 5]), abs=1e-4)
    assert marked[0, 3] == pytest.approx(truth[0, 3], abs=1e-4)


def test_the_difficulty_of_a_point_changes_from_film_to_film_and_not_the_total():
    truth, height = still()
    spreads = []
    for seed in range(60):
        errors = only(noise=0.01, difficulty_spread=0.5, persistent_share=0.0)
        detections = detect(
            truth[:400], height[:400], NAMES, 30.0, np.random.default_rng(seed), errors
        )
        spreads.append((detections.xy_px - truth[:400]).std(axis=(0, 2)) / 300)
    stated = np.array(spreads)
    assert np.sqrt((stated**2).mean()) == pytest.approx(0.01, rel=0.1)
    assert np.log(stated).std() == pytest.approx(0.5, rel=0.15)


def test_a_whole_body_is_turned_at_its_rate():
    truth, height = still()
    detections = detect(
        truth, height, NAMES, 30.0, np.random.default_rng(7), only(full_swap_rate=0.05)
    ).xy_px
    turned = np.abs(detections[:, [1, 3, 5]] - truth[:, [2, 4, 6]]).max(axis=(1, 2)) < 1
    straight = np.abs(detections - truth).max(axis=(1, 2)) < 1
    assert turned.mean() == pytest.approx(0.05, rel=0.3)
    assert (turned | straight).all()


def test_confidence_reflects_error_but_imperfectly():
    truth, height = still()
    detections = detect(truth, height, NAMES, 30.0, np.random.default_rng(3))
    detected = detections.confidence > 0
    error = np.linalg.norm(detections.xy_px - truth, axis=-1)[detected]
    ranks = np.corrcoef(
        error.argsort().argsort(), detections.confidence[detected].argsort().argsort()
    )
    assert -0.9 < ranks[0, 1] < -0.2
    assert (detections.confidence[detected] <= 1).all()


def test_false_people_are_rare_brief_and_never_absent():
    truth, height = still()
    performer = detect(truth, height, NAMES, 30.0, np.random.default_rng(4))
    for seed in range(4):
        present = [
            s is not None for s in false_people(performer, (640, 360), np.random.default_rng(seed))
        ]
        assert 1 <= sum(present) < 0.03 * FRAMES


def test_detections_of_a_clip_lie_within_noise_of_the_projected_truth(clips):
    """Truth joints through K, R_t, t reproduce the detector's wrists, knees and ankles."""
    for clip in clips:
        names = ("left_wrist", "right_wrist", "left_knee", "right_knee", "left_ankle")
        xy = project(
            clip.joints[:, [SMPL_JOINTS.index(n) for n in names]],
            clip.camera.K,
            clip.camera.R_cam_from_world,
            clip.camera.t[:, None],
        )
        columns = [7, 4, 13, 10, 14]  # the same in BODY_25's order
        detected = clip.detections.confidence[:, columns] > 0
        error = np.linalg.norm(clip.detections.xy_px[:, columns] - xy, axis=-1)[detected]
        assert 0.5 < np.median(error) < 4.0
        assert np.median(np.linalg.norm(clip.xy_px[:, columns] - xy, axis=-1)) < 2.5
