"""A lens is estimated from straight lines or from turning, and only from them."""

from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
import pytest

from imocap_core.camera import line_lens
from imocap_core.camera.parallax import parallax_test
from imocap_core.camera.projection import Lens, intrinsics
from imocap_core.camera.tripod import PairPoints, TripodCamera, TurningLens
from tests.camera.moving_tracks import FOCAL, FRAMES, room_points, tracks_of, turning
from tests.camera.moving_tracks import SIZE as TURNED_SIZE

SIZE = (480, 270)
CORNER = float(np.linalg.norm((np.array(SIZE) - 1) / 2))


def wall(rng):
    """A plain wall with dark frames in many places, larger than the picture."""
    picture = np.full((2 * SIZE[1], 2 * SIZE[0]), 170.0)
    for _ in range(45):
        x, y = rng.uniform(0, 1.7 * np.array(SIZE))
        wide, high = rng.uniform(60, 300, 2)
        turn = np.deg2rad(rng.normal(0, 8) + np.array([0, 90]))
        along, down = np.array([np.cos(turn), np.sin(turn)]).T
        corner = np.array([x, y])
        box = [corner, corner + wide * along, corner + wide * along + high * down,
               corner + high * down]  # fmt: skip
        cv2.fillPoly(picture, [np.round(box).astype(np.int32)], float(rng.uniform(40, 220)))
    return picture


def discs(rng):
    """Round things only."""
    picture = np.full((2 * SIZE[1], 2 * SIZE[0]), 170.0)
    for _ in range(60):
        middle = rng.uniform(0, 2 * np.array(SIZE)).astype(int).tolist()
        radius, shade = int(rng.uniform(20, 160)), float(rng.uniform(40, 220))
        cv2.circle(picture, middle, radius, shade, -1)
    return picture


@lru_cache
def estimated(distortion, seed=0, scene=wall):
    rng = np.random.default_rng(seed)
    shown = scene(rng)
    grid = np.stack(np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1])), axis=-1).astype(float)
    source = line_lens.centred_lens(distortion, SIZE).undistorted(grid) + 0.5 * np.array(SIZE)
    smooth = cv2.GaussianBlur(shown, (0, 0), 0.8).astype(np.float32)
    picture = cv2.remap(smooth, *source.astype(np.float32).transpose(2, 0, 1), cv2.INTER_LINEAR)
    noisy = np.clip(picture + rng.normal(0, 2, picture.shape), 0, 255).astype(np.uint8)
    return line_lens.lens_from_lines(line_lens.StillBackground(noisy, np.ones(noisy.shape, bool)))


@pytest.mark.parametrize(("distortion", "certain"), [(-0.12, True), (-0.06, True), (0.07, False)])
def test_a_bent_lens_is_estimated_within_its_claimed_error(distortion, certain):
    estimate = estimated(distortion)
    assert estimate.certain is certain
    assert estimate.distortion == pytest.approx(distortion, abs=3 * estimate.sd)
    assert 0.005 <= estimate.sd < 0.03
    lens, k1_sd = estimate.lens(intrinsics(400.0, SIZE), SIZE)
    assert lens.coefficients[0] == pytest.approx(distortion * (400 / CORNER) ** 2, abs=3 * k1_sd)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_straight_lines_leave_a_pinhole_as_it_is(seed):
    estimate = estimated(0.0, seed)
    assert not estimate.certain
    assert estimate.distortion == pytest.approx(0.0, abs=0.03)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_round_things_say_nothing(seed):
    estimate = estimated(0.0, seed, discs)
    assert estimate is None or not estimate.certain


@pytest.mark.parametrize(
    ("changed", "certain"),
    [
        ({}, True),
        ({"distortion": -0.02}, False),
        ({"distortion": -0.14}, False),
        ({"sd": 0.03}, False),
        ({"gain": 0.05}, False),
        ({"parts": 2}, False),
        ({"against": 0.3}, False),
    ],
)
def test_what_makes_it_certain(changed, certain):
    estimate = line_lens.LineLens(distortion=-0.08, sd=0.01, gain=0.3, parts=5, against=0.02)
    assert replace(estimate, **changed).certain is certain


def test_an_edge_is_found_to_a_fraction_of_a_pixel():
    x = np.arange(120)[None] - 0.1 * np.arange(90)[:, None]
    picture = (60 + 140 / (1 + np.exp(-(x - 50.3) / 0.7))).astype(np.uint8)
    (chain,) = line_lens.edge_chains(picture, np.ones(picture.shape, bool), 30)
    off = chain[:, 0] - 0.1 * chain[:, 1] - 50.3
    assert len(chain) >= 80
    assert np.abs(off).max() < 0.25


def test_edges_are_split_at_corners_and_left_out_where_nothing_is_known():
    picture = np.full((100, 140), 40, np.uint8)
    picture[20:80, 30:110] = 200
    known = np.ones(picture.shape, bool)
    assert len(line_lens.edge_chains(picture, known, 30)) == 4
    known[:, :60] = False
    assert len(line_lens.edge_chains(picture, known, 30)) == 3


def test_the_person_is_not_in_the_still_picture():
    frames, shape = 40, (60, 100)
    boxes = np.array([[2.0 * t, 10, 2 * t + 10, 50] for t in range(frames)])
    sampled = line_lens.KeptPictures(frames, {})
    for t, _ in enumerate(sampled.passing(person_at(t, shape) for t in range(frames))):
        assert len(sampled.by_frame) <= t + 1
    assert len(sampled.by_frame) < frames
    still = line_lens.still_background(sampled, boxes)
    assert still.is_background.all()
    assert (still.picture == 90).all()
    standing = line_lens.still_background(sampled, np.tile([20.0, 10, 40, 50], (frames, 1)))
    assert not standing.is_background[30, 30]
    assert standing.is_background[30, 80]


def person_at(t, shape):
    picture = np.full(shape, 90, np.uint8)
    picture[10:50, 2 * t : 2 * t + 10] = 255
    return picture


SPOT = np.zeros((FRAMES, 3))
LONG = pytest.mark.long
TURNED_CORNER = float(np.linalg.norm((np.array(TURNED_SIZE) - 1) / 2))


@lru_cache
def told(distortion, widest_deg=12.0, seed=0, **options):
    rng = np.random.default_rng(seed)
    tracks = tracks_of(room_points(rng), turning(widest_deg), SPOT, rng, distortion=distortion)
    return tracks, parallax_test(tracks, FRAMES, TURNED_SIZE, None, **options)


@pytest.mark.parametrize("distortion", [-0.13, 0.1])
def test_a_bent_lens_is_told_within_its_claimed_error(distortion):
    _, test = told(distortion)
    assert test.lens.certain
    assert test.lens.distortion == pytest.approx(distortion, abs=3 * test.lens.sd)
    assert 0.001 < test.lens.sd < 0.02
    lens, k1_sd = test.lens.lens(intrinsics(FOCAL, TURNED_SIZE), TURNED_SIZE)
    assert lens.coefficients[0] == pytest.approx(
        distortion * (FOCAL / TURNED_CORNER) ** 2, abs=3 * k1_sd
    )


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=LONG)])
def test_a_pinhole_is_not_corrected(seed):
    _, test = told(0.0, seed=seed)
    assert test.lens is None or not test.lens.certain
    assert "lens" not in test.words


@pytest.mark.parametrize("widest_deg", [pytest.param(0.1, marks=LONG), 0.5])
def test_a_camera_that_hardly_turns_tells_nothing(widest_deg):
    rng = np.random.default_rng(0)
    shaking = turning(widest_deg)[np.abs(24 - np.arange(FRAMES)) // 3]
    test = parallax_test(tracks_of(room_points(rng), shaking, SPOT, rng), FRAMES, TURNED_SIZE, None)
    assert test.verdict == "none"
    assert "lens" not in test.words
    if test.lens is not None:
        assert not test.lens.certain
        assert abs(test.lens.distortion) < 3 * test.lens.sd


def test_noise_does_not_ask_for_a_lens_that_shrinks_the_picture():
    rng = np.random.default_rng(0)
    xy = rng.uniform(-1, 1, (500, 2)) * np.array(TURNED_SIZE) / 2
    noisy = xy + rng.normal(size=xy.shape)
    points = PairPoints(*np.zeros((2, 500), int), noisy, xy, TURNED_CORNER)
    sizes = [
        np.linalg.norm(
            TripodCamera(np.log(FOCAL), d, np.zeros(1), np.eye(3)[None]).errors_px(points)
        )
        for d in (0.0, 0.3)
    ]
    assert sizes[1] == pytest.approx(sizes[0], rel=1e-3)


def test_tracks_of_a_known_lens_are_taken_as_straight():
    tracks, _ = told(-0.13)
    lens = Lens.of([-0.13], np.diag([TURNED_CORNER, TURNED_CORNER, 1.0]))
    lens.K[:2, 2] = (np.array(TURNED_SIZE) - 1) / 2
    test = parallax_test(tracks.undistorted(lens), FRAMES, TURNED_SIZE, None, straight=True)
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
