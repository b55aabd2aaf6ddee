"""The stage camera_motion: with a video it looks, without one it says that it did not."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.artifacts.schemas import Keypoints
from imocap_core.camera.projection import Lens, intrinsics, warp
from imocap_core.io.video import write_h264
from imocap_core.params import CameraMotionParams, Params
from imocap_core.pipeline.action import Action, Declaration
from imocap_core.pipeline.stage import Context, Inputs
from stages import camera_motion
from tests.made_keypoints import made_keypoints

SIZE, FRAMES = (320, 180), 10
PARAMS = Params(camera_motion=CameraMotionParams(working_size_px=160, max_features=150,
    min_inliers=15, reprojection_threshold_px=2.0, assumed_focal_factor=1.0))  # fmt: skip


def keypoints_of(video, first=0, focal_px=None, distortion=None):
    xy_px = np.full((FRAMES, 25, 2), 100.0)
    xy_px[3, 2] = np.nan
    box = np.tile([90.0, 90.0, 110.0, 110.0], (FRAMES, 1))
    video = made_keypoints(
        np.arange(first, first + FRAMES), size=SIZE, video=video, focal_px=focal_px, xy_px=xy_px,
        confidence=np.isfinite(xy_px[..., 0]).astype(float), person_box_px=box,
        distortion=distortion,
    )  # fmt: skip
    return Keypoints(videos=[video])


def run(folder, keypoints, params=PARAMS):
    declared = Declaration(id="v1", video=keypoints.videos[0].video, fps=30.0, size=SIZE,
                           keypoints="k", format="openpose", layout="body25")  # fmt: skip
    context = Context(
        stage="camera_motion", seed=0, reads=frozenset(("videos",)), report=folder,
        progress=lambda share, what: None, _action=Action(folder, "made", (declared,)),
    )  # fmt: skip
    inputs = Inputs("camera_motion", {}, {Keypoints: keypoints})
    return camera_motion.run(context, inputs, params).videos[0]


def write_pan(file, bar):
    """A texture that slides to the left by 4 pixels a frame, as a slow pan would show it, between
    two bars (in squares of 4 pixels) that do not."""
    coarse = np.random.default_rng(0).integers(30, 160, size=(45 - 2 * len(bar), 120))
    pictures = (np.vstack([bar, coarse[:, t : t + 80], bar]) for t in range(12))
    grey = (np.kron(picture, np.ones((4, 4))).astype(np.uint8) for picture in pictures)
    write_h264(file, (np.repeat(picture[..., None], 3, axis=2) for picture in grey), 30.0, crf=16)


@pytest.fixture(scope="module")
def sliding(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sliding")
    write_pan(folder / "v1.mp4", CAPTIONS[:0])
    return folder


def test_without_a_video_the_camera_stands_still_and_is_unknown(tmp_path):
    keypoints = keypoints_of(None, focal_px=500.0)
    found = run(tmp_path, keypoints)
    assert (found.motion, found.focal_source) == ("unknown", "given")
    assert np.array_equal(found.xy_first_px, keypoints.videos[0].xy_px, equal_nan=True)
    unknown = run(tmp_path, keypoints_of(None))
    assert (unknown.focal_source, unknown.K[0, 0]) == ("assumed", SIZE[0])


def test_an_assumed_focal_length_is_of_the_picture_between_black_bars(tmp_path):
    frame = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    frame[:, 110:210] = np.random.default_rng(0).integers(60, 255, size=(SIZE[1], 100, 3))
    write_h264(tmp_path / "v1.mp4", (frame for _ in range(12)), 30.0, crf=16)
    barred = run(tmp_path, keypoints_of("v1.mp4"))
    assert (barred.motion, barred.focal_source) == ("static", "assumed")
    assert barred.K[0, 0] == pytest.approx(SIZE[1], rel=0.02)
    assert "black bars" in barred.note
    assert run(tmp_path, keypoints_of("v1.mp4", focal_px=500.0)).K[0, 0] == 500.0


CAPTIONS = np.pad(np.random.default_rng(1).choice([0, 0, 0, 250], size=(14, 80)), ((1, 1), (0, 0)))


@pytest.mark.parametrize("bar", [CAPTIONS[:0], CAPTIONS], ids=["filmed", "captions in black bars"])
def test_keypoints_are_carried_back_by_the_pan(bar, tmp_path):
    write_pan(tmp_path / "v1.mp4", bar)
    found = run(tmp_path, keypoints_of("v1.mp4"))
    assert found.motion == "rotating"
    moved = found.xy_first_px[:, 0, 0] - 100.0
    assert np.allclose(moved, 4.0 * np.arange(FRAMES), atol=1.0)
    assert np.isnan(found.xy_first_px[3, 2]).all()


@pytest.mark.long
def test_the_first_used_frame_is_where_the_motion_starts(sliding):
    found = run(sliding, keypoints_of("v1.mp4", first=2))
    assert np.allclose(found.H_first_from_frame[0], np.eye(3))
    assert abs(found.xy_first_px[-1, 0, 0] - 100.0 - 4.0 * (FRAMES - 1)) < 1.0


def test_a_video_that_ends_too_early_is_named(sliding):
    with pytest.raises(ValueError, match="expected frames 5 to 14, the video ends after 7"):
        run(sliding, keypoints_of("v1.mp4", first=5))


def test_a_declared_lens_is_taken_out_of_the_keypoints(tmp_path):
    keypoints = keypoints_of(None, focal_px=300.0, distortion=(-0.25,))
    stored = run(tmp_path, keypoints)
    lens = Lens.of([-0.25], intrinsics(300.0, SIZE))
    np.testing.assert_allclose(lens.distorted(stored.xy_first_px), keypoints.videos[0].xy_px)
    assert stored.lens.source == "given"
    assert stored.lens.coefficients.tolist() == [-0.25, 0, 0, 0, 0]
    assert "its lens is corrected as declared (k1 -0.250" in stored.note


def test_a_declared_lens_is_taken_out_of_the_background_too(tmp_path):
    """What a lens shows of a turn is no homography; without the lens it is the turn again."""
    K = intrinsics(300.0, SIZE)
    lens = Lens.of([-0.25], K)
    coarse = np.random.default_rng(0).integers(0, 255, size=(110, 160), dtype=np.uint8)
    texture = np.repeat(np.kron(coarse, np.ones((4, 4), np.uint8))[:, :, None], 3, axis=2)
    grid = np.stack(np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1])), axis=-1)
    straight = lens.undistorted(grid.astype(float))
    turns = Rotation.from_rotvec([[0, 0.012 * t, 0] for t in range(FRAMES)]).as_matrix()
    H = K @ turns @ np.linalg.inv(K)
    places = (warp(of_frame, straight) + (120, 120) for of_frame in H)
    frames = (cv2.remap(texture, *np.moveaxis(p, -1, 0).astype(np.float32), 1) for p in places)
    write_h264(tmp_path / "v1.mp4", frames, 30.0, crf=12)
    stored = run(tmp_path, keypoints_of("v1.mp4", focal_px=300.0, distortion=(-0.25,)))
    assert stored.motion == "rotating"
    expected = warp(H[:, None], lens.undistorted(np.full((FRAMES, 1, 2), 100.0)))
    np.testing.assert_allclose(stored.xy_first_px[:, :1], expected, atol=0.6)
    told = run(tmp_path, keypoints_of("v1.mp4"))
    assert told.lens.source == "rotation"
    scale = (told.K[0, 0] / 300.0) ** 2  # the same displacement of pixels
    assert told.lens.coefficients[0] == pytest.approx(-0.25 * scale, abs=3 * told.lens.k1_sd)
    assert "its lens was estimated from its turning and is corrected" in told.note
