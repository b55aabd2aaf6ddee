"""A turning camera tells its lens where tracks outside the fit agree, and only there."""

from functools import lru_cache

import numpy as np
import pytest

from imocap_core.camera.parallax import parallax_test
from imocap_core.camera.projection import Lens, intrinsics
from imocap_core.camera.tripod import PairPoints, TripodCamera, TurningLens
from tests.camera.moving_tracks import FOCAL, FRAMES, SIZE, room_points, tracks_of, turning

SPOT = np.zeros((FRAMES, 3))
LONG = pytest.mark.long
CORNER = float(np.linalg.norm((np.array(SIZE) - 1) / 2))


@lru_cache
def told(distortion, widest_deg=12.0, seed=0, **options):
    rng = np.random.default_rng(seed)
    tracks = tracks_of(room_points(rng), turning(widest_deg), SPOT, rng, distortion=distortion)
    return tracks, parallax_test(tracks, FRAMES, SIZE, None, **options)


@pytest.mark.parametrize("distortion", [-0.13, 0.1])
def test_a_bent_lens_is_told_within_its_claimed_error(distortion):
    _, test = told(distortion)
    assert test.lens.certain
    assert test.lens.distortion == pytest.approx(distortion, abs=3 * test.lens.sd)
    assert 0.001 < test.lens.sd < 0.02
    lens, k1_sd = test.lens.lens(intrinsics(FOCAL, SIZE), SIZE)
    assert lens.coefficients[0] == pytest.approx(distortion * (FOCAL / CORNER) ** 2, abs=3 * k1_sd)


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=LONG)])
def test_a_pinhole_is_not_corrected(seed):
    _, test = told(0.0, seed=seed)
    assert test.lens is None or not test.lens.certain
    assert "lens" not in test.words


@pytest.mark.parametrize("widest_deg", [pytest.param(0.1, marks=LONG), 0.5])
def test_a_camera_that_hardly_turns_tells_nothing(widest_deg):
    rng = np.random.default_rng(0)
    shaking = turning(widest_deg)[np.abs(24 - np.arange(FRAMES)) // 3]
    test = parallax_test(tracks_of(room_points(rng), shaking, SPOT, rng), FRAMES, SIZE, None)
    assert test.verdict == "none"
    assert "lens" not in test.words
    if test.lens is not None:
        assert not test.lens.certain
        assert abs(test.lens.distortion) < 3 * test.lens.sd


def test_noise_does_not_ask_for_a_lens_that_shrinks_the_picture():
    rng = np.random.default_rng(0)
    xy = rng.uniform(-1, 1, (500, 2)) * np.array(SIZE) / 2
    noisy = xy + rng.normal(size=xy.shape)
    points = PairPoints(*np.zeros((2, 500), int), noisy, xy, CORNER)
    sizes = [
        np.linalg.norm(
            TripodCamera(np.log(FOCAL), d, np.zeros(1), np.eye(3)[None]).errors_px(points)
        )
        for d in (0.0, 0.3)
    ]
    assert sizes[1] == pytest.approx(sizes[0], rel=1e-3)


def test_tracks_of_a_known_lens_are_taken_as_straight():
    tracks, _ = told(-0.13)
    lens = Lens.of([-0.13], np.diag([CORNER, CORNER, 1.0]))
    lens.K[:2, 2] = (np.array(SIZE) - 1) / 2
    test = parallax_test(tracks.undistorted(lens), FRAMES, SIZE, None, straight=True)
    assert test.verdict == "none"
    assert test.lens is None
    assert test.tripod.distortion == pytest.approx(0.0, abs=1e-4)
    assert test.off_px < 1.0


@pytest.mark.parametrize(
    ("changed", "certain"),
    [
        ({}, True),
        ({"distortion": 0.01}, False),
        ({"sd": 0.04}, False),
        ({"gain": 0.05}, False),
        ({"sigmas": 2.0}, False),
        ({"apart": 0.05}, False),
    ],
)
def test_every_condition_is_needed(changed, certain):
    clear = {"distortion": -0.1, "sd": 0.006, "gain": 0.3, "sigmas": 6.0, "apart": 0.002}
    lens = TurningLens(**(clear | changed))
    assert lens.certain is certain
    told = changed.keys() <= {"gain", "apart"} and not certain
    assert ("give `distortion`" in lens.words) == told
