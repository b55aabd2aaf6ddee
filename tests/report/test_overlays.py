"""What is drawn over a frame lands where it should."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from imocap_core.artifacts.schemas import SyncMap
from imocap_core.figures.overlays import (
    CELL_PX,
    LEFT_RGB,
    MIDDLE_RGB,
    PAPER_RGB,
    RIGHT_RGB,
    Window,
    draw_body,
    draw_keypoints,
    draw_skeleton,
    from_the_side,
    windows,
)
from imocap_core.figures.sheets import frames_of_moments, spread, surfaces
from tests.report.made import K, Made


def _paper() -> np.ndarray:
    return np.full((CELL_PX[1], CELL_PX[0], 3), PAPER_RGB, dtype=np.uint8)


def test_window_camera_and_window_points_agree() -> None:
    window = Window(40.0, 25.0, 1.7)
    x = np.array([0.2, -0.3, 3.0])
    in_picture, in_cell = K @ x, window.camera(K) @ x
    np.testing.assert_allclose(
        window.points(in_picture[:2] / in_picture[2]), in_cell[:2] / in_cell[2]
    )


def test_cut_moves_pixels_as_points() -> None:
    picture = np.zeros((240, 320, 3), dtype=np.uint8)
    picture[118:123, 158:163] = 255
    window = Window(100.0, 60.0, 2.0)
    bright = np.argwhere(window.cut(picture)[:, :, 0] > 200)
    np.testing.assert_allclose(
        bright.mean(axis=0)[::-1], window.points(np.array([160.0, 120.0])), atol=1
    )


def test_windows_share_one_scale_and_bridge_unseen_frames() -> None:
    boxes = np.array([[510.0, 510, 560, 610], [np.nan] * 4, [530.0, 510, 590, 630]])
    cuts = windows(boxes, (2000, 2000))
    assert len({w.scale for w in cuts}) == 1
    assert cuts[1] in (cuts[0], cuts[2])
    centre = cuts[0].points(np.array([535.0, 560.0]))
    np.testing.assert_allclose(centre, np.array(CELL_PX) / 2)
    unseen = windows(np.full((2, 4), np.nan), (640, 360))[1]
    np.testing.assert_allclose(unseen.points(np.array([320.0, 180.0])), np.array(CELL_PX) / 2)


def test_a_window_stays_inside_a_picture_that_is_large_enough() -> None:
    corner = windows(np.array([[0.0, 320, 40, 360]]), (640, 360))[0]
    assert corner.left_px == 0
    assert corner.top_px + CELL_PX[1] / corner.scale == pytest.approx(360)
    tall = windows(np.array([[300.0, 0, 340, 360]]), (640, 360))[0]
    assert tall.top_px < 0  # does not fit: the person stays in the middle


def test_a_keypoint_without_confidence_is_not_drawn() -> None:
    xy = np.array([[50.0, 60], [100, 60], [np.nan, np.nan]])
    drawn = draw_keypoints(_paper(), xy, np.array([1.0, 0.0, 1.0]), ["left_knee"] * 3)
    changed = np.argwhere((drawn != _paper()).any(axis=2))
    assert len(changed) > 0
    assert changed[:, 1].max() < 60


def test_body_and_skeleton_cover_the_same_place(made: Made) -> None:
    keypoints, motion = made.keypoints.videos[0], made.true[0]
    window = windows(keypoints.person_box_px[:1], (2000, 2000))[0]
    vertices, faces = surfaces(made.model, motion, [0])[0], made.model.faces.numpy()
    K_cell = window.camera(K)
    body = (draw_body(_paper(), vertices, faces, K_cell) != _paper()).any(axis=2)
    bones = (draw_skeleton(_paper(), motion.joints[0], K_cell) != _paper()).any(axis=2)
    side = (from_the_side(vertices[None], faces)[0] != _paper()).any(axis=2)
    assert 0.03 < body.mean() < 0.5
    assert (body & bones).sum() > 0.85 * bones.sum()
    assert 0.01 < side.mean() < 0.5


def test_moments_find_the_nearest_frame_within_the_map_only() -> None:
    matched = np.array([np.nan, 2.0, 3.5, 5.0, 20.0])
    sync_map = SyncMap(id="v2", reference_frame=matched, confidence=np.ones(5))
    moments = np.array([0.0, 2.2, 4.4, 12.0, 20.4, 21.0])
    assert frames_of_moments(sync_map, moments) == [None, 1, 3, None, 4, None]
    unmatched = SyncMap(id="v2", reference_frame=matched * np.nan, confidence=np.zeros(5))
    assert frames_of_moments(unmatched, moments) == [None] * 6


def test_spread_is_increasing_and_inside() -> None:
    assert (np.diff(spread(100)) > 0).all()
    assert spread(100).min() > 0
    assert list(spread(1)) == [0]


def test_keypoints_look_as_if_each_were_drawn_over_the_whole_picture() -> None:
    rng = np.random.default_rng(3)
    cell = rng.integers(0, 255, (60, 80, 3), dtype=np.uint8)
    xy = rng.uniform(-6, 86, (40, 2))
    confidence = rng.uniform(0, 1.2, 40)
    names = ["left_knee", "right_knee", "neck", "nose"] * 10
    np.testing.assert_array_equal(
        draw_keypoints(cell, xy, confidence, names), _keypoints_naive(cell, xy, confidence, names)
    )


def _keypoints_naive(
    cell: np.ndarray, xy_px: np.ndarray, confidence: np.ndarray, names: list[str]
) -> np.ndarray:
    drawn = cell.copy()
    for point, trust, name in zip(xy_px, confidence, names, strict=True):
        mark = drawn.copy()
        where = (round(float(point[0])), round(float(point[1])))
        cv2.circle(mark, where, 4, (25, 28, 32), -1, cv2.LINE_AA)
        side = {"left": LEFT_RGB, "right": RIGHT_RGB}.get(name.split("_")[0], MIDDLE_RGB)
        cv2.circle(mark, where, 3, side, -1, cv2.LINE_AA)
        share = 0.3 + 0.7 * min(float(trust), 1.0)
        drawn = cv2.addWeighted(mark, share, drawn, 1 - share, 0)
    return drawn
