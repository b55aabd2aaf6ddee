"""Calibration files, read back by TOML's and OpenCV's own readers."""

from __future__ import annotations

import tomllib
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from imocap_core.io.writers.text_files import CameraCalibration, write_calibration

R = Rotation.from_rotvec([0.3, -1.2, 0.4]).as_matrix()
CAMERA = CameraCalibration(
    "cam 1",
    (1080, 1920),
    np.array([[1700.5, 0, 539.5], [0, 1700.5, 959.5], [0, 0, 1]]),
    R,
    np.array([0.1, -0.2, 4.0]),
    (-0.05,),
)


def test_calib_toml_is_what_pose2sim_reads(tmp_path: Path) -> None:
    write_calibration(tmp_path, [CAMERA])
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
    camera = CameraCalibration("cam1", CAMERA.size, CAMERA.K, R, CAMERA.t, (-0.05,))
    files = write_calibration(tmp_path, [camera])
    intri, extri = (cv2.FileStorage(str(file), cv2.FILE_STORAGE_READ) for file in files[1:])
    np.testing.assert_allclose(intri.getNode("K_cam1").mat(), camera.K)
    np.testing.assert_allclose(intri.getNode("dist_cam1").mat(), [[-0.05, 0, 0, 0, 0]])
    np.testing.assert_allclose(extri.getNode("Rot_cam1").mat(), R)
    np.testing.assert_allclose(cv2.Rodrigues(extri.getNode("R_cam1").mat())[0], R)
    np.testing.assert_allclose(extri.getNode("T_cam1").mat()[:, 0], camera.t)
    assert intri.getNode("names").at(0).string() == "cam1"


def test_a_third_radial_coefficient_is_written_where_there_is_one(tmp_path: Path) -> None:
    coefficients = (-0.2, 0.05, 0.001, -0.002, 0.01)
    camera = CameraCalibration("cam1", CAMERA.size, CAMERA.K, R, CAMERA.t, coefficients)
    files = write_calibration(tmp_path, [camera])
    table = tomllib.loads(files[0].read_text())
    assert table["cam1"]["distortions"] == list(coefficients)
    intri = cv2.FileStorage(str(files[1]), cv2.FILE_STORAGE_READ)
    np.testing.assert_allclose(intri.getNode("dist_cam1").mat(), [coefficients])
