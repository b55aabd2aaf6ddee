"""Calibration files, read back by TOML's and OpenCV's own readers."""

import csv
import tomllib
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from imocap_core.io.writers import text_files
from tests.io.made_clips import made_clip

R = Rotation.from_rotvec([0.3, -1.2, 0.4]).as_matrix()
CAMERA = text_files.CameraCalibration(
    "cam 1", (1080, 1920), np.array([[1700.5, 0, 539.5], [0, 1700.5, 959.5], [0, 0, 1]]), R,
    np.array([0.1, -0.2, 4.0]), (-0.05,),
)  # fmt: skip


def test_calib_toml_is_what_pose2sim_reads(tmp_path: Path) -> None:
    text_files.write_calibration(tmp_path, [CAMERA])
    table = tomllib.loads((tmp_path / "Calib.toml").read_text())
    camera = table["cam 1"]
    assert camera["size"] == [1080.0, 1920.0]
    np.testing.assert_allclose(camera["matrix"], CAMERA.K)
    np.testing.assert_allclose(cv2.Rodrigues(np.array(camera["rotation"]))[0], R)
    np.testing.assert_allclose(camera["translation"], CAMERA.t)
    assert camera["distortions"] == [-0.05, 0.0, 0.0, 0.0]
    assert camera["fisheye"] is False
    assert list(table) == ["cam 1", "metadata"]


def test_yml_is_opencvs_file_storage(tmp_path: Path) -> None:
    camera = text_files.CameraCalibration("cam1", CAMERA.size, CAMERA.K, R, CAMERA.t, (-0.05,))
    files = text_files.write_calibration(tmp_path, [camera])
    intri, extri = (cv2.FileStorage(str(file), cv2.FILE_STORAGE_READ) for file in files[1:])
    np.testing.assert_allclose(intri.getNode("K_cam1").mat(), camera.K)
    np.testing.assert_allclose(intri.getNode("dist_cam1").mat(), [[-0.05, 0, 0, 0, 0]])
    np.testing.assert_allclose(extri.getNode("Rot_cam1").mat(), R)
    np.testing.assert_allclose(cv2.Rodrigues(extri.getNode("R_cam1").mat())[0], R)
    np.testing.assert_allclose(extri.getNode("T_cam1").mat()[:, 0], camera.t)
    assert intri.getNode("names").at(0).string() == "cam1"


def test_a_third_radial_coefficient_is_written_where_there_is_one(tmp_path: Path) -> None:
    coefficients = (-0.2, 0.05, 0.001, -0.002, 0.01)
    camera = text_files.CameraCalibration("cam1", CAMERA.size, CAMERA.K, R, CAMERA.t, coefficients)
    files = text_files.write_calibration(tmp_path, [camera])
    table = tomllib.loads(files[0].read_text())
    assert table["cam1"]["distortions"] == list(coefficients)
    intri = cv2.FileStorage(str(files[1]), cv2.FILE_STORAGE_READ)
    np.testing.assert_allclose(intri.getNode("dist_cam1").mat(), [coefficients])


def test_trc_comes_back(tmp_path: Path) -> None:
    clip = made_clip(fps=29.97).clip
    text_files.write_trc(tmp_path / "v1.trc", clip)
    lines = (tmp_path / "v1.trc").read_text().split("\n")
    assert lines[0] == "PathFileType\t4\t(X/Y/Z)\tv1.trc"
    about = dict(zip(lines[1].split("\t"), lines[2].split("\t"), strict=True))
    assert about["Units"] == "mm"
    assert about["DataRate"] == about["CameraRate"] == about["OrigDataRate"] == "29.97"
    assert (about["NumFrames"], about["NumMarkers"]) == ("12", "24")
    assert (about["OrigDataStartFrame"], about["OrigNumFrames"]) == ("7", "12")
    names = lines[3].split("\t")
    assert names[:2] == ["Frame#", "Time"]
    assert names[2::3][:24] == list(clip.joint_names)
    assert lines[4].split("\t")[2:8] == ["X1", "Y1", "Z1", "X2", "Y2", "Z2"]
    assert lines[5] == ""
    rows = np.array([[float(x) for x in line.split("\t")] for line in lines[6:-1]])
    np.testing.assert_array_equal(rows[:, 0], np.arange(1, 13))
    np.testing.assert_allclose(rows[:, 1], np.arange(12) / 29.97, atol=1e-6)
    np.testing.assert_allclose(rows[:, 2:].reshape(12, 24, 3), 1000 * clip.joints, atol=6e-4)


def test_trc_names_the_nearest_first_frame(tmp_path: Path) -> None:
    clip = made_clip().clip
    text_files.write_trc(tmp_path / "x.trc", replace(clip, frames=clip.frames + 0.4))
    assert (tmp_path / "x.trc").read_text().split("\n")[2].split("\t")[6] == "7"


def test_csv_comes_back(tmp_path: Path) -> None:
    clip = made_clip(hands=True).clip
    phase = clip.phase_s.copy()
    phase[3] = np.nan
    inside = clip.inside.copy()
    inside[-1] = False
    frames = clip.frames + 0.25
    sd = {"left_wrist": np.where(np.arange(len(phase)) == 2, np.nan, 12.5)}
    written = replace(clip, phase_s=phase, inside=inside, frames=frames)
    text_files.write_joints_csv(tmp_path / "v1.csv", written, sd)
    with (tmp_path / "v1.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["inside"] for row in rows] == ["1"] * 11 + ["0"]
    assert rows[3]["phase_s"] == ""
    assert [row["left_wrist_sd_m"] for row in rows[1:4]] == ["0.012500", "", "0.012500"]
    assert "right_wrist_sd_m" not in rows[0]
    assert rows[0]["frame"] == "7.25"
    for j, name in enumerate(clip.joint_names):
        ours = [[float(row[f"{name}_{axis}_m"]) for axis in "xyz"] for row in rows]
        np.testing.assert_allclose(ours, clip.joints[:, j], atol=6e-7)
