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


def place(seed: int, frames: int, *, speed: float = 0.5) -> list[np.ndarray]:
    """A camera that pans over a textured place, grey, 160 x 90."""
    rng = np.random.default_rng(seed)
    layers = [cv2.resize(rng.random((n, 4 * n)), (900, 90)) for n in (3, 8, 20)]
    wide = (255 * np.clip(sum(layers) / 3, 0, 1)).astype(np.float64)
    wide = 20 + 0.85 * np.clip((wide - 127) * 2 + 127, 0, 255)
    starts = [round(speed * t) for t in range(frames)]
    noisy = [wide[:, s : s + 160] + rng.normal(0, 2, (90, 160)) for s in starts]
    return [np.clip(picture, 0, 255).astype(np.uint8) for picture in noisy]


def mixed(a: list[np.ndarray], b: list[np.ndarray], frames: int, kind: str) -> list[np.ndarray]:
    """Two shots, the end of the first and the beginning of the second one over each other."""
    middle = []
    for i in range(frames):
        share, x, y = (i + 1) / (frames + 1), a[len(a) - frames + i], b[i]
        if kind == "dissolve":
            middle.append(np.rint((1 - share) * x.astype(float) + share * y).astype(np.uint8))
        else:
            edge = round(share * x.shape[1])
            middle.append(np.concatenate([y[:, :edge], x[:, edge:]], axis=1))
    return [*a[: len(a) - frames], *middle, *b[frames:]]


def faded(a: list[np.ndarray], b: list[np.ndarray], frames: int) -> list[np.ndarray]:
    """Two shots, out to black and in again."""
    ramp = [1 - (i + 1) / (frames + 1) for i in range(frames)]
    out = [np.rint(x * s).astype(np.uint8) for x, s in zip(a[-frames:], ramp, strict=True)]
    into = [np.rint(x * s).astype(np.uint8) for x, s in zip(b[:frames], ramp[::-1], strict=True)]
    return [*a[:-frames], *out, *into, *b[frames:]]


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
