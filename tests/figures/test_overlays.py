"""What is drawn over a frame lands where it should, whatever `matplotlibrc` there is."""

from dataclasses import replace
from pathlib import Path

import cv2
import matplotlib as mpl
import numpy as np
import pytest
import torch

from imocap_core import rotations
from imocap_core.artifacts.schemas import GroundPlane, SyncMap
from imocap_core.camera.projection import Lens, frame_projections
from imocap_core.figures.overlays import (
    CELL_PX,
    LEFT_RGB,
    MIDDLE_RGB,
    PAPER_RGB,
    RIGHT_RGB,
    Window,
    blank_cell,
    draw_body,
    draw_keypoints,
    draw_skeleton,
    from_the_side,
    windows,
)
from imocap_core.figures.sheets import (
    body_cells,
    body_sheet,
    frames_of_moments,
    sheet_ids,
    sheet_videos,
    spread,
    surfaces,
    upright_world,
)
from imocap_core.figures.style import new_figure, quiet, save
from imocap_core.film import OverlayBody, Painter, overlay_bodies, overlay_film
from imocap_core.io.video import write_h264
from imocap_core.lock_step import NEUTRAL_RGB, source_frames
from imocap_core.viewer.viewer_video import cutter
from tests.report.made import FPS, SIZE, K, Made


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
    drawn = cell.copy()
    for point, trust, name in zip(xy, confidence, names, strict=True):
        mark = drawn.copy()
        where = (round(float(point[0])), round(float(point[1])))
        cv2.circle(mark, where, 4, (25, 28, 32), -1, cv2.LINE_AA)
        side = {"left": LEFT_RGB, "right": RIGHT_RGB}.get(name.split("_")[0], MIDDLE_RGB)
        cv2.circle(mark, where, 3, side, -1, cv2.LINE_AA)
        share = 0.3 + 0.7 * min(float(trust), 1.0)
        drawn = cv2.addWeighted(mark, share, drawn, 1 - share, 0)
    np.testing.assert_array_equal(draw_keypoints(cell, xy, confidence, names), drawn)


def _videos(made: Made):
    files = dict.fromkeys(made.ids)
    return sheet_videos(
        made.keypoints, made.camera_motion, made.initial, made.refined, files, made.model
    )


def _misfit(video, px: float):
    errors = np.full(len(video.final.frames), px)
    return replace(video, final=video.final.model_copy(update={"reprojection_px": errors}))


def test_the_reference_and_the_video_that_fits_worst_have_a_sheet() -> None:
    made = Made()
    videos = [_misfit(v, px) for v, px in zip(_videos(made), (9.0, 5.0, 2.0), strict=True)]
    assert sheet_ids(made.refined, videos) == ["v1", "v2"]
    assert sheet_ids(made.refined, [videos[0], _misfit(videos[1], 1.0), videos[2]]) == ["v1", "v3"]
    excluded = made.refined.rounds[1].sync.model_copy(update={"excluded": ["v2"]})
    refined = made.refined.model_copy(update={"sync": excluded})
    assert sheet_ids(refined, videos) == ["v1", "v3"]
    made = Made(count=1)
    assert sheet_ids(made.refined, _videos(made)) == ["v1"]


def test_the_world_of_the_sheets_is_upright() -> None:
    made = Made()
    ground = upright_world(made.refined)
    assert ground.R_upright_from_world @ [0, -1, 0] == pytest.approx([0, 1, 0], abs=0.1)


def test_bodies_from_the_side_stand_on_level_ground_however_the_camera_is_held() -> None:
    made = Made(2)
    up = rotations.exp(torch.tensor([0.4, 0.0, 0.1], dtype=torch.float64)).numpy() @ [0, -1, 0]
    plane = GroundPlane(up=up, origin=np.zeros(3), tilt_sd_deg=1.0, height_sd_mm=9.0)
    motion = made.refined.motion.model_copy(update={"ground": plane})
    made.refined = made.refined.model_copy(update={"motion": motion})
    for video, camera in zip(_videos(made), motion.cameras, strict=True):
        cut = dict(enumerate(windows(video.keypoints.person_box_px[:1], (2000, 2000))))
        _, level = body_cells(video, video.final, K, made.model, [0], {0: _paper()}, cut)
        in_world = surfaces(made.model, video.final, [0]) @ camera.R  # t is 0
        assert level[..., 1] == pytest.approx(in_world @ up)


def test_a_sheet_without_pictures_has_a_column_for_each_phase_and_one_at_rest() -> None:
    made = Made()
    video, frames = _videos(made)[0], [1, 6, 11]
    camera, ground = made.refined.motion.cameras[0], upright_world(made.refined)
    with quiet():
        figure = body_sheet(
            video, camera, ground, made.model, frames, {t: blank_cell() for t in frames}
        )
    texts = [text.get_text() for text in figure.texts]
    for name in ("picture", "front", "side", "back", "at rest", "frame 1", "frame 6", "frame 11"):
        assert name in texts


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
    seen = frame_projections(camera.H_first_from_frame, K) @ x_first
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


def drawn():
    figure = new_figure(2.0, 1.5)
    axes = figure.add_subplot()
    axes.plot([0, 1], [1, 0])
    axes.set_title("a title")
    return figure


def picture(file: Path) -> bytes:
    with quiet():
        save(drawn(), file)
    return file.read_bytes()


def test_settings_of_others_change_no_figure(tmp_path: Path) -> None:
    theirs = {"axes.facecolor": "red", "lines.linestyle": ":", "text.usetex": True}
    expected = picture(tmp_path / "a.png")
    with mpl.rc_context(theirs):  # type: ignore[arg-type]
        assert picture(tmp_path / "b.png") == expected
        assert {name: mpl.rcParams[name] for name in theirs} == theirs


def test_the_style_ends_with_an_error(tmp_path: Path) -> None:
    before = dict(mpl.rcParams)
    with pytest.raises(ZeroDivisionError), quiet():
        assert 1 / (mpl.rcParams["font.size"] == 0)
    assert dict(mpl.rcParams) == before


def test_a_figure_is_as_matplotlib_lays_it_out(tmp_path: Path) -> None:
    laid_out = picture(tmp_path / "a.png")
    with quiet():
        figure = drawn()
        figure.savefig(tmp_path / "b.png", dpi=figure.dpi, metadata={"Software": None})
    assert laid_out == (tmp_path / "b.png").read_bytes()
