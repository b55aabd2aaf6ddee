"""The recovered body lands where the person is, in still and in turning cameras, with and without
a video; films have the frames they should."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from imocap_core import rotations
from imocap_core.camera.projection import Lens
from imocap_core.film import (
    NEUTRAL_RGB,
    OverlayBody,
    Painter,
    overlay_bodies,
    overlay_film,
    projections,
    source_frames,
)
from imocap_core.io.video import write_h264
from imocap_core.viewer.viewer_video import cutter
from tests.report.made import FPS, SIZE, K, Made


def _cast(made: Made, files: dict[str, Path | None]) -> list[OverlayBody]:
    keypoints, cameras = made.keypoints, made.camera_motion
    return overlay_bodies(keypoints, cameras, made.true, None, files, made.model, {})


def _neutral() -> np.ndarray:
    return np.full((SIZE[1], SIZE[0], 3), NEUTRAL_RGB, np.uint8)


def test_a_turning_camera_s_pixels_and_depths_are_those_of_its_own_axes(made: Made) -> None:
    turn = rotations.exp(torch.tensor([[0.0, 0.02 * t, 0.01 * t] for t in range(16)]).double())
    R_first_from_frame = turn.numpy()
    H = K @ R_first_from_frame @ np.linalg.inv(K)
    camera = made.camera_motion.videos[0].model_copy(
        update={"H_first_from_frame": 1.7 * H, "R_first_from_frame": R_first_from_frame}
    )
    x_first = np.array([0.3, -0.2, 3.0])
    seen = projections(camera, K) @ x_first
    x_frame = np.swapaxes(R_first_from_frame, 1, 2) @ x_first
    np.testing.assert_allclose(seen, x_frame @ K.T, atol=1e-9)


def test_the_body_covers_its_keypoints(made: Made) -> None:
    for performer in _cast(made, {"v1": Path("some.mp4"), "v2": Path("some.mp4")})[:2]:
        painter = Painter(performer, made.model, alpha=1.0)
        for t in (0, 15, 7):  # batches in any order
            painted = (painter(t, _neutral()) != _neutral()).any(axis=2)
            x, y = np.rint(performer.keypoints.xy_px[t]).astype(int).T
            inside = (x >= 0) & (x < SIZE[0]) & (y >= 0) & (y < SIZE[1])
            assert painted[y[inside], x[inside]].mean() > 0.8
            rows, columns = np.nonzero(painted)
            box = performer.keypoints.person_box_px[t]
            centre = (box[:2] + box[2:]) / 2
            assert np.abs([columns.mean(), rows.mean()] - centre).max() < 40


def test_the_body_is_painted_where_the_lens_shows_it(made: Made) -> None:
    pinhole = _cast(made, {"v1": Path("some.mp4")})[0]
    lens = Lens.of([-0.3], K)
    bent = Painter(replace(pinhole, lens=lens), made.model, alpha=1.0)
    straight = Painter(pinhole, made.model, alpha=1.0)
    grid = np.stack(np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1])), axis=-1)
    source = lens.undistorted(grid.astype(float)).astype(np.float32)
    expected = cv2.remap(straight(7, _neutral()), source[..., 0], source[..., 1], cv2.INTER_LINEAR)
    painted, should, before = (
        np.abs(image.astype(int) - _neutral()).max(axis=2) > 40
        for image in (bent(7, _neutral()), expected, straight(7, _neutral()))
    )
    inside = (source > 0).all(-1) & (source < np.array(SIZE) - 1).all(-1)
    assert (painted == should)[inside].mean() > 0.99
    assert (painted != before).sum() > 3 * (painted != should)[inside].sum()


def test_the_viewer_s_pictures_are_without_distortion() -> None:
    lens = Lens.of([-0.3], K)
    grid = np.stack(np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1])), axis=-1)
    straight = np.repeat(grid[..., :1] % 256, 3, axis=2).astype(np.uint8)
    marks = np.array([[200.0, 100.0], [150.0, 200.0]])
    filmed = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    for x, y in lens.distorted(marks):
        cv2.circle(filmed, (round(x), round(y)), 3, (255, 255, 255), -1)
    shown = cutter((0, 0, *SIZE), lens)(filmed)
    for x, y in marks.astype(int):
        assert shown[y, x].min() > 128
    part = cutter((100, 50, 120, 100), lens)(filmed)
    np.testing.assert_array_equal(part, shown[50:150, 100:220])
    np.testing.assert_array_equal(cutter((5, 7, 60, 50), None)(straight), straight[7:57, 5:65])


def test_a_part_of_the_picture_is_painted_as_the_part_of_the_whole(made: Made) -> None:
    painter = Painter(_cast(made, {"v1": Path("some.mp4")})[0], made.model, alpha=0.6)
    whole = painter(3, _neutral())
    move = np.array([[1.0, 0, -100], [0, 1, -40], [0, 0, 1]])
    part = painter(3, np.ascontiguousarray(_neutral()[40:200, 100:260]), move)
    np.testing.assert_array_equal(part, whole[40:200, 100:260])


def test_without_a_video_the_keypoints_are_shown(made: Made) -> None:
    with_video, without = (
        Painter(_cast(made, {"v1": file})[0], made.model, alpha=0.0)(2, _neutral())
        for file in (Path("some.mp4"), None)
    )
    assert (with_video == _neutral()).all()
    marked = (without != _neutral()).any(axis=2)
    x, y = np.rint(made.keypoints.videos[0].xy_px[2]).astype(int).T
    assert marked[np.clip(y, 0, 239), np.clip(x, 0, 319)].mean() > 0.8
    assert marked.mean() < 0.05


def test_source_frames_skip_repeat_and_stand_still_at_the_end(tmp_path: Path) -> None:
    file = tmp_path / "v.mp4"
    write_h264(file, (np.full((32, 32, 3), 20 * n, np.uint8) for n in range(8)), FPS)
    wanted = np.array([1, 1, 4, 7, 9])
    found = [float(p.mean()) for p in source_frames(file, wanted, (32, 32))]
    assert found == pytest.approx([20, 20, 80, 140, 140], abs=4)
    blank = list(source_frames(None, wanted, (40, 30)))
    assert len(blank) == 5
    assert blank[0].shape == (30, 40, 3)
    assert (blank[0] == NEUTRAL_RGB).all()


def test_the_overlay_film_has_every_used_frame_named_and_tinted(made: Made, tmp_path: Path) -> None:
    file = tmp_path / "v2.mp4"
    write_h264(file, (np.full((240, 320, 3), 10 * n, np.uint8) for n in range(24)), FPS)
    performer = _cast(made, {"v2": file})[1]
    film = list(overlay_film(performer, made.model, alpha=0.7))
    assert len(film) == len(made.frames[1])
    for frame, picture in zip(made.frames[1], film, strict=True):
        assert picture.shape == (240, 320, 3)
        assert (picture[2, 2] == performer.rgb).all()
        assert picture[-4:, -4:].mean() == pytest.approx(10 * frame, abs=4)
    other = list(overlay_film(replace(performer, rgb=(0, 160, 0)), made.model, alpha=0.7))
    green, own = (p.astype(float).mean(axis=(0, 1)) for p in (other[5], film[5]))
    assert green[1] - green[0] > own[1] - own[0] + 1
