"""A result as values: shapes, frames and identities between them."""

import csv
import json
import shutil
import struct
from pathlib import Path

import numpy as np
import pytest
import torch

import imocap
from imocap_core.artifacts.schemas import Hands, Uncertainty, VideoUncertainty
from imocap_core.biomechanics.joint_angles import angle_names
from imocap_core.body import load_free_body
from imocap_core.camera.gravity import Z_UP_FROM_Y_UP as Q
from imocap_core.cli import main
from tests.library.conftest import SmallRun
from tests.pipeline.made_result import (
    FPS,
    LENGTHS,
    PHASES,
    Made,
    hands,
    made_result,
    motion,
    refined,
    turned,
    world_motion,
)


@pytest.fixture
def made(tmp_path: Path) -> Made:
    return made_result(tmp_path)


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> imocap.Result:
    return made_result(tmp_path_factory.mktemp("result")).result()


def test_it_is_a_collection_of_videos(result: imocap.Result) -> None:
    assert result.ids == ("a", "b")
    assert len(result) == 2
    assert [video.id for video in result] == ["a", "b"]
    assert "a" in result
    assert "c" not in result
    assert result.reference == result.sync.reference == "a"
    assert result.model.startswith("free_body ")
    assert list(result.cameras) == ["a", "b"]
    with pytest.raises(imocap.WrongUse, match="walk has no video 'c'; there are: a, b"):
        result["c"]


def test_a_result_has_a_verdict(result: imocap.Result) -> None:
    assert result.verdict.summary[0].startswith("a and b are matched")
    assert str(result.verdict).splitlines() == list(result.verdict.summary)
    assert result.levelled("y").verdict == result.verdict


def test_arrays_and_their_shapes(result: imocap.Result) -> None:
    video = result["b"]
    T = LENGTHS["b"]
    assert len(video) == T
    assert video.joints.shape == (T, 24, 3)
    assert len(video.joint_names) == 24
    assert video.rotations.shape == (T, 24, 3, 3)
    assert video.poses.shape == (T, 72)
    assert video.betas.shape == (10,)
    assert video.trans.shape == (T, 3)
    assert video.vertices(np.array([0, 3])).shape == (2, video.faces.max() + 1, 3)
    np.testing.assert_array_equal(video.frames, 100 + np.arange(T))
    np.testing.assert_allclose(video.time_s, video.frames / FPS["b"])
    np.testing.assert_allclose(video.phase_s, PHASES["b"])
    np.testing.assert_allclose(video.joint("head"), video.joints[:, 15])
    assert video.uncertainty is None
    assert video.video is None
    with pytest.raises(imocap.WrongUse, match="no joint 'nose'; there are: pelvis"):
        video.joint("nose")


def test_all_videos_are_in_one_world(result: imocap.Result) -> None:
    """Both show the motion that was made, which is in the axes of `a`."""
    theta, _ = world_motion(PHASES["b"])
    made = load_free_body().shape(torch.as_tensor(result["b"].betas))
    local = torch.as_tensor(result["b"].rotations)
    posed = made.pose(local, torch.as_tensor(result["b"].trans)).joints.numpy()
    np.testing.assert_allclose(posed, result["b"].joints, atol=1e-6)
    np.testing.assert_allclose(result["b"].poses[:, 3:], theta[:, 3:], atol=1e-9)
    a, b = result.at_phase(0.5)["a"], result.at_phase(0.5)["b"]
    np.testing.assert_allclose(a.joints, b.joints, atol=1e-3)


def test_a_camera_projects_what_its_video_shows(result: imocap.Result) -> None:
    """A camera that turns and zooms: K R^T, frame by frame; its measured homographies are
    K R K^-1, so that both ways give one pixel."""
    video = result["b"]
    camera, own = video.camera, motion("b").joints
    R, zoom = turned("b").R_first_from_frame, turned("b").zoom
    K = camera.K_per_frame
    np.testing.assert_allclose(K[:, 0, 0], 600 * zoom)
    ahead = np.einsum("tij,tnj->tni", camera.R_per_frame, video.joints - camera.centre)
    np.testing.assert_allclose(ahead, own @ R, atol=1e-9)
    homogeneous = np.einsum("tij,tnj->tni", K, ahead)
    expected = homogeneous[..., :2] / homogeneous[..., 2:]
    expected[homogeneous[..., 2] <= 0] = np.nan
    np.testing.assert_allclose(camera.project(video.joints), expected, atol=1e-6)
    assert not camera.is_static
    assert result["a"].camera.is_static
    px = result["a"].camera.project(result["a"].joints)
    joints = motion("a").joints
    np.testing.assert_allclose(px, (joints @ camera.K.T)[..., :2] / joints[..., 2:], atol=1e-9)
    one = result["a"].camera.project(result["a"].joints[4], np.array([4]))
    np.testing.assert_allclose(one[0], px[4])
    behind = result["a"].camera.project(np.array([[0.0, 0.0, -1.0]]))
    assert behind.shape == (LENGTHS["a"], 1, 2)
    assert np.isnan(behind).all()


def test_a_moment_is_given_for_the_videos_that_show_it(result: imocap.Result) -> None:
    assert list(result.at_phase(0.05)) == ["a"]  # b begins at 0.1 s
    both = result.at_phase(0.35)
    assert both["b"].index == pytest.approx(5.0)
    assert both["b"].frame == pytest.approx(105.0)
    assert both["b"].time_s == pytest.approx(105 / 20)
    assert both["a"].index == pytest.approx(10.5)
    assert both["a"].confidence == pytest.approx(1.0)
    assert result.at_phase(99.0) == {}
    with pytest.raises(imocap.WrongUse, match="phase_s: expected a finite number"):
        result.at_phase(float("nan"))


def test_which_frame_matches_which(result: imocap.Result) -> None:
    to_reference = result["b"].matches("a")
    np.testing.assert_allclose(to_reference.index, 30 * PHASES["b"])
    np.testing.assert_allclose(to_reference.confidence, 1.0)
    back = result["a"].matches(result["b"])
    shown = np.isfinite(back.index)
    np.testing.assert_array_equal(shown, PHASES["a"] >= 0.1 - 1e-12)
    np.testing.assert_allclose(back.index[shown], (PHASES["a"][shown] - 0.1) * 20, atol=1e-9)
    np.testing.assert_allclose(back.frame[shown], 100 + back.index[shown])
    assert (back.confidence[~shown] == 0).all()
    with pytest.raises(imocap.WrongUse, match="no video 'z'; there are: a, b"):
        result["a"].matches("z")


@pytest.mark.parametrize(("up", "axis"), [("y", 1), ("z", 2)])
def test_a_levelled_world_keeps_what_cameras_see(result: imocap.Result, up: str, axis: int) -> None:
    level = result.levelled(up)
    assert isinstance(level, imocap.Result)
    assert level.up_axis == up
    assert level["a"].joint("head")[:, axis].min() > 1.2
    for before, after in zip(result, level, strict=True):
        np.testing.assert_allclose(
            after.camera.project(after.joints), before.camera.project(before.joints), atol=1e-6
        )
        np.testing.assert_allclose(after.rotations[:, 1:], before.rotations[:, 1:], atol=1e-9)
    with pytest.raises(imocap.WrongUse, match="up: expected y or z, got 'x'"):
        result.levelled("x")


def test_on_the_common_axis_everybody_has_the_same_phases(result: imocap.Result) -> None:
    common = result.on_common_time()
    np.testing.assert_allclose(common["a"].phase_s, common["b"].phase_s)
    both = common["a"].inside & common["b"].inside
    assert np.abs(common["a"].joints - common["b"].joints)[both].max() < 1e-3
    assert (common["b"].confidence[~common["b"].inside] == 0).all()


def test_hands_give_52_joints(made: Made) -> None:
    bare, body = made.result()["b"], load_free_body(hands=True)
    about = {"model": body.name, "model_digest": body.digest, "size": 1.0, "status": "made"}
    made.publish("hands", Hands(videos=[hands(v) for v in LENGTHS], **about))
    video = made.result()["b"]
    assert video.joints.shape == (LENGTHS["b"], 52, 3)
    assert video.rotations.shape == (LENGTHS["b"], 52, 3, 3)
    assert video.poses.shape == (LENGTHS["b"], 156)
    assert len(video.joint_names) == 52
    np.testing.assert_allclose(video.joints[:, :22], bare.joints[:, :22], atol=1e-6)
    np.testing.assert_allclose(video.hands.points[:, :, 3], bare.joints[:, 20:22], atol=1e-9)
    assert made.result().on_common_time()["b"].joints.shape == (34, 52, 3)


def test_uncertainty_is_in_world_axes(made: Made) -> None:
    rng = np.random.default_rng(0)
    videos, covariances = [], {}
    for v, n in LENGTHS.items():
        half = rng.standard_normal((n, 24, 3, 3))
        covariances[v] = half @ half.swapaxes(-1, -2)
        trace = np.trace(covariances[v], axis1=-2, axis2=-1)
        videos.append(
            VideoUncertainty(
                id=v, frames=100 + np.arange(n), sigma_mm=np.sqrt(trace), depth_mm=trace,
                across_mm=trace, covariance_mm2=covariances[v].astype(np.float32), azimuth_deg=0.0,
                rotation_covariance_deg2=covariances[v][:, :15].astype(np.float32),
                deviation_covariance_deg2=covariances[v][:, :15].astype(np.float32),
            )
        )  # fmt: skip
    made.publish(
        "uncertainty",
        Uncertainty(
            videos=videos, median_mm=1.0, weak=[], near=[],
            viewpoints=[], azimuth_from="camera", status="",
        ),
    )  # fmt: skip
    video = made.result()["b"]
    trace = np.trace(video.covariance_mm2, axis1=-2, axis2=-1)
    np.testing.assert_allclose(np.sqrt(trace), video.uncertainty, rtol=1e-5)
    R = video.camera.R
    back = R @ video.covariance_mm2 @ R.T
    np.testing.assert_allclose(back, covariances["b"], atol=1e-4)


def test_without_a_common_axis_it_is_said(made: Made) -> None:
    made.publish("refine_sync", refined(None))
    result = made.result()
    assert result.at_phase(0.1) == {}
    with pytest.raises(imocap.WorkFailed, match="walk has no common time axis"):
        result.on_common_time()


def test_motions_and_cameras_are_those_of_the_y_up_world_turned_by_a_quarter(small_run):
    y, z = (small_run.result.levelled(up) for up in "yz")
    for a, b in zip(y, z, strict=True):
        np.testing.assert_allclose(b.joints, a.joints @ Q.T, atol=1e-9)
        np.testing.assert_allclose(b.rotations[:, 0], Q @ a.rotations[:, 0], atol=1e-9)
        np.testing.assert_allclose(b.rotations[:, 1:], a.rotations[:, 1:], atol=1e-9)
        np.testing.assert_allclose(b.vertices(np.array([3])), a.vertices(np.array([3])) @ Q.T)
        np.testing.assert_allclose(b.camera.centre, Q @ a.camera.centre, atol=1e-9)
        np.testing.assert_allclose(b.camera.R, a.camera.R @ Q.T, atol=1e-9)


def test_levelling_again_changes_nothing(small_run: SmallRun) -> None:
    once, back = small_run.result.levelled("y"), small_run.result.levelled("z").levelled("y")
    for a, b in zip(once, back, strict=True):
        np.testing.assert_allclose(b.joints, a.joints, atol=1e-9)
    common = small_run.result.on_common_time().levelled("y")
    for a, b in zip(once.on_common_time(), common, strict=True):
        np.testing.assert_allclose(b.camera.centre, a.camera.centre, atol=1e-9)
        np.testing.assert_allclose(b.trans, a.trans, atol=1e-9)


@pytest.mark.parametrize(("up", "axis"), [("y", 1), ("z", 2)])
def test_a_result_has_its_ground(small_run: SmallRun, up: str, axis: int) -> None:
    result, level = small_run.result, small_run.result.levelled(up)
    np.testing.assert_allclose(np.linalg.norm(result.ground.up), 1.0)
    assert 0.3 < result.ground.tilt_sd_deg < 10
    assert result.ground.height_sd_mm >= 10
    np.testing.assert_allclose(level.ground.up, np.eye(3)[axis], atol=1e-9)
    np.testing.assert_allclose(level.ground.origin, 0, atol=1e-9)
    for before, after in zip(result, level, strict=True):
        height = result.ground.height_m(before.joints)
        np.testing.assert_allclose(after.joints[..., axis], height, atol=1e-9)


def test_files_of_both_are_one_world(small_run: SmallRun, tmp_path: Path) -> None:
    y, z = (
        {f.name: f for f in small_run.result.export("npz", tmp_path / up, up=up)} for up in "yz"
    )
    for name in ("v1.npz", "v2.npz"):
        with np.load(y[name]) as a, np.load(z[name]) as b:
            np.testing.assert_allclose(b["joints"], a["joints"] @ Q.T, atol=1e-6)
            np.testing.assert_allclose(b["R"], a["R"] @ Q.T, atol=1e-6)
            np.testing.assert_allclose(b["t"], a["t"], atol=1e-6)
    bvh = [small_run.result.export("bvh", tmp_path / f"bvh_{up}", up=up)[0] for up in "yz"]
    a, b = (_root_path(file) for file in bvh)
    np.testing.assert_allclose(b, a @ Q.T, atol=1e-5)


def test_a_glb_of_the_z_up_world_is_that_of_the_y_up_world(small_run, tmp_path):
    glb = [small_run.result.levelled(up).export("glb", tmp_path / up)[0] for up in "yz"]
    a, b = (_binary_chunk(file) for file in glb)
    np.testing.assert_allclose(b, a, atol=1e-5)


def _root_path(bvh: Path) -> np.ndarray:
    """(T, 3) positions of the root in a BVH file."""
    motion = bvh.read_text().split("Frame Time:")[1].splitlines()[1:]
    return np.array([[float(x) for x in line.split()[:3]] for line in motion if line.strip()])


def _binary_chunk(glb: Path) -> np.ndarray:
    """The numbers of a GLB file, all that are of single precision."""
    content = glb.read_bytes()
    (length,) = struct.unpack_from("<I", content, 12)
    gltf = json.loads(content[20 : 20 + length])
    data = content[28 + length :]
    parts = []
    for accessor in gltf["accessors"]:
        if accessor["componentType"] == 5126:
            view = gltf["bufferViews"][accessor["bufferView"]]
            size = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}.get(accessor["type"], 2)
            start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
            parts.append(np.frombuffer(data, "<f4", size * accessor["count"], start))
    return np.concatenate(parts)


def rows(file: Path) -> list[dict[str, str]]:
    with file.open(newline="") as stream:
        return list(csv.DictReader(stream))


@pytest.fixture(scope="module")
def angles(small_run: SmallRun, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The files of the small run's angles."""
    return imocap.angles("serve", tmp_path_factory.mktemp("angles"), root=small_run.root).files


def test_tables_of_every_video_and_their_mean(small_run: SmallRun, angles: list[Path]) -> None:
    folder = angles[0].parent
    assert [file.name for file in angles] == [
        *("v1_angles.csv", "v1_events.csv", "v2_angles.csv", "v2_events.csv"),
        *("mean_angles.csv", "mean_events.csv", "angles.png", "export_angles.json"),
    ]
    table = rows(folder / "v1_angles.csv")
    assert len(table) == len(small_run.result["v1"])
    assert {f"{name}_deg" for name in angle_names()} < set(table[0])
    assert all(-180 <= float(row["left_knee_flexion_deg"]) <= 180 for row in table)
    assert all(float(row["left_knee_flexion_sd_deg"]) > 0 for row in table)
    mean = rows(folder / "mean_angles.csv")
    assert max(int(row["performances"]) for row in mean) == 2
    assert json.loads((folder / "export_angles.json").read_text())["run"]["seed"] == 7


def test_events_are_those_of_the_result(small_run: SmallRun, angles: list[Path]) -> None:
    for video, events in small_run.result.events().items():
        table = rows(angles[0].with_name(f"{video}_events.csv"))
        assert [(row["kind"], row["name"]) for row in table] == [(e.kind, e.name) for e in events]
        times = [float(row["time_s"]) for row in table]
        assert times == sorted(times)
        assert all(0 <= e.index <= len(small_run.result[video]) - 1 for e in events)


@pytest.mark.long
def test_the_command_replaces_its_files_and_no_others(small_run, angles, tmp_path):
    words = ["angles", "serve", "--out", str(tmp_path), "--root", str(small_run.root)]
    for file in angles:
        shutil.copy(file, tmp_path)
    table, before = tmp_path / "v1_angles.csv", (tmp_path / "export_angles.json").stat().st_mtime_ns
    assert main(words) == 0
    assert (tmp_path / "export_angles.json").stat().st_mtime_ns > before
    table.write_text("mine")
    assert main(words) == 1
    assert table.read_text() == "mine"
