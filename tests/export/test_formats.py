"""imocap export in every format: one action, two videos, written and read back."""

import csv
import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from mcap.reader import make_reader

from imocap_core.artifacts.schemas import Keypoints
from imocap_core.body import load_free_body
from imocap_core.body.model import rotations_from_pose
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.export.blender import FORMATS as OF_BLENDER
from imocap_core.export.clips import camera_of, linear
from imocap_core.export.export_options import ExportOptions
from imocap_core.export.formats import WRITERS, export
from imocap_core.io.video import write_h264
from imocap_core.result.result import Time
from tests.pipeline.made_result import (
    FPS,
    LENGTHS,
    PHASES,
    Made,
    keypoints,
    made_result,
    refined,
    turned,
)


@pytest.fixture
def made(tmp_path: Path) -> Made:
    return made_result(tmp_path)


def table(file: Path) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """The first columns by name, the joints (T, 24, 3)."""
    with file.open(newline="") as stream:
        head, *rows = csv.reader(stream)
    values = np.array([[float(x) if x else np.nan for x in row] for row in rows])
    return dict(zip(head[:4], values[:, :4].T, strict=True)), values[:, 4:].reshape(-1, 24, 3)


NO_BLENDER = pytest.mark.skipif(
    "IMOCAP_BLENDER" not in os.environ, reason="IMOCAP_BLENDER names no interpreter with bpy"
)
NO_RERUN = pytest.mark.skipif(find_spec("rerun") is None, reason="rerun-sdk is not installed")
FORMATS = [
    pytest.param(f, marks=NO_BLENDER if f in OF_BLENDER else NO_RERUN if f == "rrd" else ())
    for f in sorted({*WRITERS} - {"calib"})  # of which a camera here, as it turns, is none
]


@pytest.mark.parametrize("format", FORMATS)
@pytest.mark.parametrize("time", ["own", "common"])
def test_every_format_writes_its_files_and_says_what_they_are(made, format, time):
    done = made.export(format, time=time)
    assert done.notes == []
    assert all(f.stat().st_size > 100 for f in done.files)
    names = [f.name for f in done.files]
    assert names[-3:] == ["sync.csv", "cameras.json", f"export_{format}.json"]
    notes = json.loads(done.files[-1].read_text())
    assert {"up_axis", "world", "units", "pivot", "time", "videos", "body_model"} <= set(notes)
    rates = [notes["videos"][v]["frames_per_second"] for v in LENGTHS]
    assert rates == ([30.0, 20.0] if time == "own" else [30.0, 30.0])
    assert notes["up_axis"] == {
        "npz": "-y",
        "csv": "-y",
        "mcap": "z",
        "rrd": "z",
        "c3d": "z",
        "amass": "z",
    }.get(format, "y")
    frames = [notes["videos"][v]["frames"] for v in LENGTHS]
    assert frames == ([31, 21] if time == "own" else [34, 34])


def test_a_recording_for_rerun_says_what_to_install(made, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(WorkFailed, match=r"pip install 'imocap\[rerun\]'"):
        made.export("rrd")


@NO_RERUN
def test_rerun_reads_bodies_and_cameras_of_every_video(made: Made) -> None:
    made.export("rrd")
    words = [sys.executable, "-m", "rerun", "rrd", "stats", str(made.out / "walk.rrd")]
    stats = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    for video in LENGTHS:
        assert all(f"/{video}/{part}" in stats for part in ("joints", "bones", "camera"))
    for component in ("Pinhole:image_from_camera", "Transform3D:mat3x3", "Points2D:positions"):
        assert component in stats


def test_a_calibration_is_of_cameras_that_stand(made: Made) -> None:
    with pytest.raises(WrongUse, match="the camera of b turns"):
        made.export("calib")
    done = export(made.result(), "calib", made.out, options=ExportOptions(videos=("a",)))
    assert [f.name for f in done.files[:3]] == ["Calib.toml", "intri.yml", "extri.yml"]
    assert json.loads(done.files[-1].read_text())["up_axis"] == "z"


def test_on_the_common_axis_equal_rows_are_equal_moments(made: Made) -> None:
    made.export("csv", time="common")
    (about, a), (about_b, b) = (table(made.out / f"{v}_joints.csv") for v in LENGTHS)
    np.testing.assert_allclose(about["phase_s"], np.arange(34) / 30, atol=1e-6)
    np.testing.assert_allclose(about_b["phase_s"], about["phase_s"])
    both = (about["inside"] * about_b["inside"]).astype(bool)
    assert both.sum() == 28  # from 0.1 to 1.0 s
    assert np.abs(a - b)[both].max() < 5e-4  # metres: between frames b is interpolated
    np.testing.assert_allclose(b[0], b[3], atol=1e-9)  # not shown yet: its first pose
    assert np.abs(a[0] - a[3]).max() > 0.01
    np.testing.assert_allclose(a[31:], np.broadcast_to(a[30], (3, 24, 3)), atol=1e-9)
    np.testing.assert_allclose(about_b["frame"][3:33], 100 + np.arange(30) * 20 / 30, atol=2e-4)


@pytest.mark.parametrize("time", ["own", "common"])
def test_npz_through_smpl_gives_its_joints(made: Made, time: str) -> None:
    made.export("npz", up="z", time=time)
    for video in LENGTHS:
        with np.load(made.out / f"{video}.npz") as data:
            shaped = load_free_body().shape(torch.as_tensor(data["betas"]))
            local = rotations_from_pose(torch.as_tensor(data["poses"]))
            joints = shaped.pose(local, torch.as_tensor(data["trans"])).joints.numpy()
            assert 1000 * np.abs(joints - data["joints"]).max() < 1e-3
            assert (
                data["mocap_framerate"] == data["fps"] == (30 if time == "common" else FPS[video])
            )
            assert ("phase_s" in data.files) == (time == "common")
            heights = data["joints"][..., 2]
            assert heights[:, SMPL_JOINTS.index("head")].min() > 1.2
            assert abs(heights[:, SMPL_JOINTS.index("left_foot")].min()) < 0.1


def test_a_cameras_turning_goes_with_it(made: Made) -> None:
    result = made.result().levelled("y")
    b = result["b"]
    camera = camera_of(b)
    point = b.joints[20, 0]
    first = b.camera.R @ point + b.camera.t
    in_frame = turned("b").R_first_from_frame[20].T @ first
    ours = camera.R_cam_from_world[20] @ (point - camera.centre[0])
    np.testing.assert_allclose(ours, in_frame, atol=1e-9)
    assert len(camera_of(result["a"]).R_cam_from_world) == 1
    common = camera_of(result.on_common_time()["b"])
    np.testing.assert_allclose(
        common.R_cam_from_world[9], camera.R_cam_from_world[4], atol=1e-7
    )  # 0.3 s on the axis is its frame 4


def test_who_has_no_place_on_the_axis_is_left_out_and_named(made: Made) -> None:
    nowhere = {"a": PHASES["a"], "b": np.full(21, np.nan)}
    made.publish("refine_sync", refined(nowhere))
    done = made.export("bvh", time="common")
    assert done.notes == ["left out, as they have no place on the common axis: b"]
    assert not (made.out / "b.bvh").exists()
    assert json.loads(done.files[-1].read_text())["left_out"] == ["b"]
    assert (made.out / "sync.csv").read_text().count("\nb,") == 21
    assert len(made.export("bvh", time="own").files) == 5


@pytest.mark.parametrize("time", ["own", "common"])
def test_a_view_file_shows_the_frames_of_its_moments(made: Made, time: Time) -> None:
    """Every frame of the clip has a grey of its own."""
    clip = (np.full((36, 64, 3), 10 + number, np.uint8) for number in range(131))
    made.out.mkdir()
    write_h264(made.out / "a.mp4", clip, fps=30)
    first, second = (keypoints(v) for v in LENGTHS)
    filmed = first.model_copy(update={"video": "a.mp4"})
    made.publish("keypoints", Keypoints(videos=[filmed, second]))
    export(made.result(made.out), "mcap", made.out / "view", None, time)
    with (made.out / "view" / "walk.mcap").open("rb") as stream:
        messages = list(make_reader(stream).iter_messages(topics=["/a/camera/image"]))
    assert len(messages) == 31
    for _, _, message in messages[::6]:
        found = CompressedImage.FromString(message.data)
        picture = cv2.imdecode(np.frombuffer(found.data, np.uint8), cv2.IMREAD_COLOR)
        assert picture.shape == (270, 480, 3)
        number = round(message.log_time * 30 / 1e9)
        assert picture.mean() == pytest.approx(110 + number, abs=2.5)
    (made.out / "a.mp4").unlink()
    with pytest.raises(WorkFailed, match="there is no such video"):
        export(made.result(made.out), "mcap", made.out / "view", None, time)


def test_a_view_files_camera_zooms(made: Made) -> None:
    made.export("mcap")
    with (made.out / "walk.mcap").open("rb") as stream:
        lenses = [
            CameraCalibration.FromString(m.data)
            for _, _, m in make_reader(stream).iter_messages(topics=["/b/camera/calibration"])
        ]
    assert lenses[-1].K[0] / lenses[0].K[0] == pytest.approx(1.5)
    assert lenses[0].K[0] == pytest.approx(600 * 480 / 640)
    assert (lenses[0].width, lenses[0].height) == (480, 270)


def test_a_body_of_another_version_is_said(made: Made) -> None:
    found = refined(PHASES)
    other = found.motion.model_copy(update={"model_digest": "0" * 64})
    made.publish("refine_sync", found.model_copy(update={"motion": other}))
    with pytest.raises(WorkFailed, match=r"made with the body model free_body \(000000000000\)"):
        made.export("bvh")
    made.export("npz")  # which needs no body


def test_a_colour_in_linear_light() -> None:
    assert linear("#ffffff") == (1.0, 1.0, 1.0)
    assert linear("#000000") == (0.0, 0.0, 0.0)
    assert linear("#808080")[0] == pytest.approx(0.2159, abs=1e-4)
