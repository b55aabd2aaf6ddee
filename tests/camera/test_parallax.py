"""A background tells a camera that walks from one that turns, zooms or has a bent lens."""

import cv2
import numpy as np
import pytest

from benchmarks.synthetic.films import furniture
from benchmarks.synthetic.moving_yoga import CameraWalk, walk_camera
from imocap_core.camera.background import FeatureTracks, track_features
from imocap_core.camera.parallax import gric, parallax_test
from imocap_core.synthetic.cameras import CameraPlacement
from imocap_core.synthetic.rooms import raycast, room
from tests.camera.moving_tracks import (
    FOCAL,
    FRAMES,
    SIZE,
    room_points,
    tracks_of,
    turning,
    wall_points,
)

LONG = pytest.mark.long
SPOT = np.zeros((FRAMES, 3))


def walk(metres):
    return np.linspace(0, 1, FRAMES)[:, None] * np.array([metres, 0.0, 0.0])


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=LONG)])
@pytest.mark.parametrize("distortion", [0.0, 0.12, pytest.param(-0.1, marks=LONG)])
def test_a_turning_camera_shows_no_parallax_and_tells_its_lens(seed, distortion):
    rng = np.random.default_rng(seed)
    tracks = tracks_of(room_points(rng), turning(), SPOT, rng, distortion=distortion)
    test = parallax_test(tracks, FRAMES, SIZE, None)
    assert test.verdict == "none"
    assert test.tripod.focal_px == pytest.approx(FOCAL, rel=0.06)
    assert test.tripod.distortion == pytest.approx(distortion, abs=0.03)


def test_a_zooming_camera_shows_no_parallax():
    rng = np.random.default_rng(4)
    zoom = np.linspace(1.0, 1.8, FRAMES)
    tracks = tracks_of(room_points(rng), turning(6.0), SPOT, rng, zoom=zoom)
    test = parallax_test(tracks, FRAMES, SIZE, None)
    assert test.verdict == "none"
    assert np.exp(test.tripod.log_zoom[-1]) == pytest.approx(1.8, rel=0.05)


@pytest.mark.parametrize("metres", [0.4, *(pytest.param(x, marks=LONG) for x in (-1.5, 1.0))])
def test_a_walk_is_told_from_a_turn(metres):
    rng = np.random.default_rng(5)
    tracks = tracks_of(room_points(rng), turning(), walk(metres), rng)
    assert parallax_test(tracks, FRAMES, SIZE, None).verdict == "found"
    assert parallax_test(tracks, FRAMES, SIZE, FOCAL).verdict == "found"


def test_a_far_background_cannot_show_a_walk():
    rng = np.random.default_rng(6)
    tracks = tracks_of(300 * room_points(rng), turning(), walk(1.0), rng)
    test = parallax_test(tracks, FRAMES, SIZE, None)
    assert test.verdict == "none"
    assert "far or flat background" in test.words


def test_a_walk_along_a_wall_is_a_move_before_a_flat_background():
    rng = np.random.default_rng(7)
    tracks = tracks_of(wall_points(rng), turning(), walk(2.0), rng)
    test = parallax_test(tracks, FRAMES, SIZE, FOCAL)
    assert test.moves == (test.verdict == "flat")
    assert test.verdict != "found"


def test_too_few_features_test_nothing():
    rng = np.random.default_rng(8)
    tracks = tracks_of(room_points(rng, 12), turning(), walk(1.0), rng)
    assert parallax_test(tracks, FRAMES, SIZE, None).verdict == "untested"
    nothing = FeatureTracks(np.zeros(0, int), np.zeros(0, int), np.zeros((0, 2)))
    assert parallax_test(nothing, FRAMES, SIZE, None).verdict == "untested"


def test_the_criterion_prefers_fewer_dimensions_at_equal_errors():
    error = np.full(50, 0.3)
    spot, depth = gric(error, dimension=2, unknowns=4), gric(error, dimension=3, unknowns=7)
    assert spot < depth
    assert gric(10 * error, dimension=2, unknowns=4) > depth


def test_tracks_of_a_walk_follow_points_of_the_room():
    """Corners of things at several depths obey epipolar geometry, and no homography."""
    view, size, frames = CameraPlacement(20.0, 4.5, 1.3, 1.0), (320, 180), 16
    path = np.tile([0.0, 0.0, 0.9], (frames, 1))
    camera = walk_camera(view, CameraWalk(0.5), path, 25.0, size, np.random.default_rng(1))
    surfaces = room(0, view.azimuth_deg, np.random.default_rng(2))
    surfaces += furniture(view.azimuth_deg, 3, np.random.default_rng(3))
    frames_rt = list(zip(camera.R_cam_from_world, camera.centres, strict=True))
    pictures = [
        cv2.cvtColor(raycast(surfaces, camera.K, R, c, size, 1), cv2.COLOR_RGB2GRAY)
        for R, c in frames_rt
    ]
    box = np.tile([120.0, 60.0, 200.0, 170.0], (frames, 1))
    tracks = track_features(pictures, box, 25.0, max_features=200)
    inside = (tracks.xy_px > (120, 60)) & (tracks.xy_px < (200, 170))
    assert not inside.all(axis=1).any()
    ids, first, last = tracks.common(0, frames - 1)
    assert len(ids) > 60
    inlier = cv2.findFundamentalMat(first, last, cv2.USAC_MAGSAC, 1.0, 0.999, 1000)[1]
    assert inlier.mean() > 0.85
    assert cv2.findHomography(first, last, cv2.USAC_MAGSAC, 1.0)[1].mean() < 0.85


def test_points_burnt_into_the_picture_are_no_background() -> None:
    frame, track = (x.ravel() for x in np.meshgrid(np.arange(50), np.arange(8), indexing="ij"))
    moved = np.where(track > 2, 2.0 * frame, 0.0)
    tracks = FeatureTracks(track, frame, np.stack([moved, 9.0 * track], axis=-1))
    assert set(tracks.without_graphics().track) == {3, 4, 5, 6, 7}
    resting = FeatureTracks(track, frame, np.stack([0 * moved, 9.0 * track], axis=-1))
    assert len(resting.without_graphics().track) == len(track)
