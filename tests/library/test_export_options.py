"""Export options on a run: which videos, whose mean, from where, as what character; the camera of
every frame, where it moves."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import imocap
from imocap_core.adapters.participants import mirrored_camera
from imocap_core.adapters.relative_motion import paths_of, relative_motions
from imocap_core.artifacts.schemas import Camera, VideoMotion
from imocap_core.camera.projection import Lens, intrinsics, project
from imocap_core.cli import main
from imocap_core.export.export_options import ExportOptions
from imocap_core.result.derived import fade, from_start, mean_performance
from imocap_core.result.video import VideoCamera
from tests.library.conftest import SmallRun


@pytest.mark.parametrize("up", ["y", "z"])
def test_a_motion_starts_at_the_origin_facing_forward(small_run: SmallRun, up: str) -> None:
    level = small_run.result.levelled(up)
    begun = from_start(level, level.videos[0])
    first = begun.videos[0]
    flat = [0, 2] if up == "y" else [0, 1]
    np.testing.assert_allclose(first.body_joints[0, 0, flat], 0, atol=1e-9)
    ahead = first.rotations[0, 0] @ [0, 0, 1]
    forward = np.array([0, 0, 1.0]) if up == "y" else np.array([0, -1.0, 0])
    assert ahead @ forward > 0.9 * np.linalg.norm(ahead[flat])
    for before, after in zip(level, begun, strict=True):
        gaps = [np.linalg.norm(v.body_joints[0] - v.camera.centre, axis=1) for v in (before, after)]
        np.testing.assert_allclose(*gaps, atol=1e-9)
        height = "xyz".index(up)
        np.testing.assert_allclose(
            before.body_joints[..., height], after.body_joints[..., height], atol=1e-9
        )


def test_the_mean_of_equal_performances_is_each_of_them(small_run: SmallRun) -> None:
    common = small_run.result.levelled("y").on_common_time()
    one = common.only(["v1"])
    again = mean_performance(one)
    np.testing.assert_allclose(again["mean"].body_joints, one["v1"].body_joints, atol=1e-6)
    both = mean_performance(common)["mean"]
    low = np.minimum(common["v1"].trans, common["v2"].trans) - 1e-9
    high = np.maximum(common["v1"].trans, common["v2"].trans) + 1e-9
    assert ((low <= both.trans) & (both.trans <= high)).all()
    assert both.inside.all()


def test_weights_fade_where_a_performance_begins_and_ends() -> None:
    inside = np.array([False] * 5 + [True] * 40 + [False] * 3)
    weights = fade(inside, fps=20)
    assert (weights[~inside] == 0).all()
    assert (weights[inside] > 0).all()
    assert np.abs(np.diff(weights)).max() < 0.2
    assert weights.max() == 1


def test_a_character_of_one_video(small_run: SmallRun, tmp_path: Path) -> None:
    options = ExportOptions(("v2",), origin="start", names="ue5", root_bone=True)
    files = small_run.result.export("bvh", tmp_path, options=options)
    assert [f.name for f in files if f.suffix == ".bvh"] == ["v2.bvh"]
    text = (tmp_path / "v2.bvh").read_text()
    assert "ROOT root" in text
    assert "JOINT upperarm_l" in text
    notes = json.loads((tmp_path / "export_bvh.json").read_text())
    assert notes["options"]["names"] == "ue5"
    assert list(notes["videos"]) == ["v2"]


def test_the_mean_as_a_skinned_mesh(small_run: SmallRun, tmp_path: Path) -> None:
    options = imocap.ExportOptions(mean=True, names="mixamo", root_bone=True)
    files = small_run.result.export("glb", tmp_path, options=options)
    data = files[0].read_bytes()
    assert data[:4] == b"glTF"
    assert b"mixamorig:Hips" in data
    assert b'"mean_body"' in data


@pytest.mark.parametrize("up", ["y", "z"])
def test_feet_that_are_locked_do_not_slide(small_run, tmp_path, up):
    options = imocap.ExportOptions(mean=True, lock_feet=True)
    small_run.result.export("npz", tmp_path, up=up, options=options)
    notes = json.loads((tmp_path / "export_npz.json").read_text())
    lock = notes["foot_lock"]["mean"]
    assert lock["slides_mm"] <= min(1e-3, lock["slid_mm"]) or lock["short"] > 0
    assert len(np.load(tmp_path / "mean.npz")["poses"]) == notes["videos"]["mean"]["frames"]


def test_locked_feet_are_said(small_run, tmp_path, capsys):
    words = ["--out", str(tmp_path), "--root", str(small_run.root), "--video", "v1", "--lock-feet"]
    assert main(["export", "serve", "--format", "npz", *words]) == 0
    message = capsys.readouterr().out.replace("\n", " ")
    assert "v1: feet in contact (" in message or "v1: no foot stands" in message


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--format", "csv", "--names", "mixamo"], "csv has none"),
        (["--mean", "--video", "v1"], "leave --video out"),
        (["--video", "v9"], "has no video 'v9'; there are: v1, v2"),
    ],
)
def test_options_that_do_not_fit_are_refused(small_run, tmp_path, capsys, words, sentence):
    out = ["--out", str(tmp_path), "--root", str(small_run.root)]
    assert main(["export", "serve", *out, *words]) == 2
    assert sentence in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


FRAMES, SIZE = 6, (480, 270)
K = intrinsics(450.0, SIZE)
TURNS = Rotation.from_rotvec(np.linspace([0, 0, 0], [0.02, 0.3, 0.01], FRAMES)).as_matrix()
PATH = np.linspace([0, 0, 0], [0.8, -0.1, 0.4], FRAMES)
R = Rotation.from_rotvec([0.1, 0.7, -0.05]).as_matrix()
T = np.array([0.2, 0.1, 4.0])


def camera(path_m: np.ndarray | None) -> VideoCamera:
    H = K @ TURNS @ np.linalg.inv(K)
    return VideoCamera("v1", SIZE, K, R, T, TURNS, np.ones(FRAMES), H, path_m)


def test_its_frames_project_as_it_does():
    points = np.random.default_rng(1).normal(0, 0.5, (FRAMES, 7, 3))
    for moving in (camera(PATH), camera(None)):
        frames = (moving.K_per_frame, moving.R_per_frame, moving.t_per_frame)
        pixels = [project(x, *of_frame) for x, *of_frame in zip(points, *frames, strict=True)]
        np.testing.assert_allclose(moving.project(points), pixels, atol=1e-8)
        some = np.array([0, 4])
        np.testing.assert_allclose(moving.project(points[some], some), np.array(pixels)[some])


def test_a_lens_is_drawn_and_belongs_to_its_focal_length():
    points, pinhole = np.random.default_rng(1).normal(0, 0.5, (7, 3)), camera(None)
    lens = Lens.of([-0.2, 0.05], intrinsics(400.0, SIZE))
    bent = replace(pinhole, lens=lens)
    np.testing.assert_allclose(bent.project(points), lens.distorted(pinhole.project(points)))
    assert bent.distortion[0] == pytest.approx(-0.2 * (450 / 400) ** 2)
    assert bent.distortion_at(intrinsics(400.0, SIZE)) == pytest.approx([-0.2, 0.05, 0, 0, 0])
    assert not pinhole.distortion.any()


def test_it_starts_in_its_first_place_and_walks_its_path():
    places = camera(PATH).centre_per_frame
    np.testing.assert_allclose(places[0], camera(None).centre)
    np.testing.assert_allclose(
        np.linalg.norm(places - places[0], axis=1), np.linalg.norm(PATH, axis=1)
    )
    assert not camera(PATH).is_static


def test_a_motion_relative_to_the_camera_is_seen_from_its_first_place():
    joints = np.random.default_rng(2).normal(0, 0.3, (FRAMES, 24, 3)) + (0, 0, 4)
    motion = VideoMotion(
        id="v1", frames=np.arange(FRAMES), theta=np.zeros((FRAMES, 72)), betas=np.zeros(10),
        trans=joints[:, 0], joints=joints, reprojection_px=np.zeros(FRAMES),
    )  # fmt: skip
    solved = Camera(id="v1", K=K, R=R, t=T, path_m=PATH)
    moved = relative_motions([motion], paths_of([solved]))[0]
    np.testing.assert_allclose(moved.joints, joints - PATH[:, None])
    assert relative_motions([motion], {}) == [motion]


def test_a_mirrored_path_is_that_of_the_mirror_image():
    solved = Camera(id="v1", K=K, R=R, t=T, path_m=PATH)
    np.testing.assert_allclose(mirrored_camera(solved).path_m, PATH * (-1, 1, 1))
    np.testing.assert_allclose(mirrored_camera(mirrored_camera(solved)).path_m, PATH)
