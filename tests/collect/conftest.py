"""A film of five shots whose people are in the cache of detections already."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from imocap_core.body import load_free_body
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.detect.detection import detections_file
from imocap_core.detect.detectors import detector_of
from imocap_core.io.video import write_h264
from imocap_core.params import DetectParams
from imocap_core.workspace import Workspace
from tests.collect.made_shots import place

# of the free body in front of a camera, as BlazePose writes them
SQUAT = {
    "left_hip": (-100, 0, 25),
    "right_hip": (-100, 0, -10),
    "left_knee": (110, 0, 0),
    "right_knee": (110, 0, 0),
    "spine2": (35, 45, 0),
    "left_shoulder": (0, -70, 40),
    "right_shoulder": (0, 30, -120),
}
HANGING = {"left_shoulder": (0, 0, -75), "right_shoulder": (0, 0, 75)}


def landmarks(kind: str, frames: int, *, azimuth_deg: float, seed: int) -> np.ndarray:
    """(T, 33, 4): x, y as shares of a picture of 160 x 90, z, visibility."""
    depth = np.sin(np.pi * np.linspace(0, 1, frames)) ** 2 if kind == "squat" else np.zeros(frames)
    angles = np.zeros((frames, 24, 3))
    for joint, degrees in HANGING.items():
        angles[:, SMPL_JOINTS.index(joint)] = degrees
    for joint, degrees in SQUAT.items():
        angles[:, SMPL_JOINTS.index(joint)] += depth[:, None] * np.array(degrees)
    R = Rotation.from_euler("xyz", angles.reshape(-1, 3), degrees=True).as_matrix()
    body = load_free_body(dtype=torch.float64)
    shaped = body.shape(torch.zeros(body.num_betas, dtype=torch.float64))
    down = np.stack([0 * depth, -0.35 * depth, 0 * depth], axis=1)
    posed = shaped.pose(torch.as_tensor(R.reshape(frames, 24, 3, 3)), torch.as_tensor(down))
    points = posed.keypoints(body.points("blazepose33")).numpy()
    turned = points @ Rotation.from_euler("y", azimuth_deg, degrees=True).as_matrix().T
    in_camera = turned * [1, -1, -1] + [0, -0.15, 4.5]
    xy = 160 * in_camera[..., :2] / in_camera[..., 2:] / [160, 90] + 0.5
    noise = np.random.default_rng(seed).normal(0, 0.002, (frames, 33, 2))
    rows = np.full((frames, 33, 4), np.nan)
    columns = np.array(body.points("blazepose33").columns)
    rows[:, columns, :2] = (xy + noise)[:, : len(columns)]
    rows[:, columns, 2] = 0.0
    rows[:, columns, 3] = 0.95
    return rows


SPEEDS = (0.3, 0.3, 0.3, 0.075, 0.0)  # of the cameras that pan, pixels a frame
BLACK = 12  # frames


@pytest.fixture(scope="session")
def film(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A working folder, and in it a film: a squat from the front, standing, the squat from
    another side, the first one at a quarter of its speed, an empty place, black frames."""
    root = tmp_path_factory.mktemp("collected")
    parts = [
        landmarks("squat", 60, azimuth_deg=0, seed=1),
        landmarks("stand", 40, azimuth_deg=20, seed=2),
        landmarks("squat", 60, azimuth_deg=-20, seed=3),
        landmarks("squat", 240, azimuth_deg=0, seed=1),
        np.full((20, 33, 4), np.nan),
    ]
    pictures = [
        cv2.cvtColor(picture, cv2.COLOR_GRAY2RGB)
        for k, part in enumerate(parts)
        for picture in place(1 if k == 3 else k + 1, len(part), speed=SPEEDS[k])
    ]
    black = [np.zeros_like(pictures[0])] * BLACK
    file = root / "long film.mp4"
    write_h264(file, [*pictures, *black], 30.0)
    detector = detector_of(DetectParams(), root)
    cached = detections_file(Workspace(root).store, file, detector)
    cached.parent.mkdir(parents=True)
    every = np.concatenate([*parts, np.full((BLACK, 33, 4), np.nan)])
    np.savez(cached, frames=np.arange(len(every)), pose_landmarks=every[:, None])
    return root, file
