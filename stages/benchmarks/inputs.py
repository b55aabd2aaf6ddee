"""Action folders made of captured motion: simulated detections and estimates, and the truth.

The stages see these files only. A folder appears complete or not at all, and is made again when
the code that made it has changed.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from imocap_core.camera.projection import project
from imocap_core.conventions import EVAL_14
from imocap_core.synthetic.captured import (
    VIEWPOINTS,
    coco18_points,
    hip_middle,
    place_camera,
    stature_m,
    to_stage,
)
from imocap_core.synthetic.detector import Detections
from imocap_core.synthetic.estimator import estimate
from imocap_core.synthetic.levels import detect_person
from imocap_core.synthetic.samplings import sample_frames
from imocap_core.synthetic.trials import on_one_stage
from stages.harness.errors import WorkFailed
from stages.harness.source import closure

Floats = NDArray[np.float64]

DATA_VARIABLE = "IMOCAP_DATA"
SIZE = (1000, 1000)
SEED = 7
MAX_VIDEOS = len(VIEWPOINTS)
# Resampled clips jump where no real performance does: up to a whole segment in one frame.
RESAMPLED_MAX_RATE = 30.0
MADE = ".made.json"


@dataclass(frozen=True)
class Shot:
    """One video to be: joints (T, 14, 3) on the stage where it is filmed, phase (T,), and the
    frames that the video keeps. The truth speaks of a common world that may lie elsewhere."""

    joints_m: Floats
    phase: Floats
    kept: NDArray[np.int64]
    fps: float  # of joints_m
    R_common_from_stage: Floats = field(default_factory=lambda: np.eye(3))
    t_common: Floats = field(default_factory=lambda: np.zeros(3))

    def truth(self, video: str, K: Floats, R: Floats, t: Floats) -> dict[str, Floats]:
        """What truth.npz holds of it; R, t is the camera from the stage."""
        R_cam_from_common = R @ self.R_common_from_stage.T
        joints = self.joints_m[self.kept] @ self.R_common_from_stage.T + self.t_common
        parts = {
            "joints": joints,
            "phase": self.phase[self.kept],
            "K": K,
            "R": R_cam_from_common,
            "t": t - R_cam_from_common @ self.t_common,
        }
        return {f"{video}/{name}": value for name, value in parts.items()}


def data_folder(root: Path, kind: str) -> Path:
    """The folder of captured motion `kind` (protocol, trials); WorkFailed says where it was looked
    for."""
    named = os.environ.get(DATA_VARIABLE)
    base = Path(named) if named else root.resolve().parent / "shared" / "data"
    folder = base / kind
    if not any(folder.glob("*.npz")):
        raise WorkFailed(
            f"the benchmark {kind} needs captured motion, and {folder} holds no .npz file; put the "
            f"data there or set {DATA_VARIABLE} to the folder that holds {kind}/ (the benchmark "
            "yoga needs no data)"
        )
    return folder


def protocol_shots(file: Path, sampling: str, videos: int) -> list[Shot]:
    """One motion, resampled for each video."""
    with np.load(file) as stored:
        joints = stored["joints"][:, stored["common14_idx"]].astype(np.float64)
        fps = float(stored["fps"])
    turn, shift = to_stage(joints)
    world = turn.apply(joints.reshape(-1, 3)).reshape(joints.shape) + shift
    phase = np.arange(len(world), dtype=np.float64)
    return [
        Shot(world, phase, sample_frames(sampling, len(world), v, _rng(file.stem, v, 0)), fps)
        for v in range(videos)
    ]


def trial_shots(file: Path, videos: int) -> list[Shot]:
    """Another performance for each video, the file's first ones."""
    with np.load(file) as stored:
        index, fps = stored["common14_idx"], float(stored["fps"])
        count = min(videos, len(stored["trial_ids"]))
        trials = [stored[f"trial_{v:02d}"][:, index].astype(np.float64) for v in range(count)]
    return [
        Shot(p.joints_m, p.phase, np.arange(len(p.phase)), fps, p.R_common_from_stage, p.t_common)
        for p in on_one_stage(trials)
    ]


def make_action(
    folder: Path, name: str, shots: Sequence[Shot], detector: str, params: dict[str, Any]
) -> None:
    """Write the action `name` into `folder` unless today's code made what is there."""
    key = _key(name, shots, detector, params)
    made = folder / MADE
    if made.is_file() and made.read_text() == key:
        return
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{folder.name}.", dir=folder.parent) as draft:
        new = Path(draft) / "new"
        new.mkdir()
        _write(new, name, shots, detector, params)
        (new / MADE).write_text(key)
        if folder.exists():
            shutil.rmtree(folder)
        new.rename(folder)


def _write(
    folder: Path, name: str, shots: Sequence[Shot], detector: str, params: dict[str, Any]
) -> None:
    truth: dict[str, Any] = {
        "joint_names": np.array(EVAL_14),
        "phase_end": max(float(shots[0].phase[-1]), 1.0),
    }
    videos = []
    for v, shot in enumerate(shots):
        video = f"v{v + 1}"
        rng = _rng(name, v, 1)
        K, R, t = place_camera(VIEWPOINTS[v], shot.joints_m, SIZE)
        joints_cam = shot.joints_m @ R.T + t
        estimated = estimate(joints_cam, shot.fps, rng)[shot.kept]
        found = _detections(shot, K, R, t, detector, rng)
        _write_openpose(folder / "keypoints" / video, video, found, shot.kept)
        (folder / "initial").mkdir(exist_ok=True)
        np.savez(folder / "initial" / f"{video}.npz", joints=estimated, joint_names=list(EVAL_14))
        truth |= shot.truth(video, K, R, t)
        videos.append(_declaration(video, shot))
    np.savez(folder / "truth.npz", **truth)
    action = {"name": name, "videos": videos, "truth": "truth.npz", "params": params}
    (folder / "action.yaml").write_text(yaml.safe_dump(action, sort_keys=False))


def _detections(
    shot: Shot, K: Floats, R: Floats, t: Floats, detector: str, rng: np.random.Generator
) -> Detections:
    points = coco18_points(shot.joints_m)
    depth = (hip_middle(shot.joints_m) @ R.T + t)[:, 2]
    height_px = K[0, 0] * stature_m(shot.joints_m) / median_filter(depth, 5)
    return detect_person(project(points, K, R, t), height_px, shot.fps, detector, rng)


def _declaration(video: str, shot: Shot) -> dict[str, Any]:
    """A resampled video's frame rate is the mean rate of the frames it keeps."""
    return {
        "id": video,
        "keypoints": f"keypoints/{video}",
        "format": "openpose",
        "layout": "coco18",
        "fps": round(shot.fps * len(shot.kept) / len(shot.phase), 3),
        "size": list(SIZE),
        "initial": f"initial/{video}.npz",
        "initial_format": "joints_npz",
    }


def _write_openpose(folder: Path, video: str, found: Detections, kept: NDArray[np.int64]) -> None:
    folder.mkdir(parents=True)
    for number, frame in enumerate(kept):
        rows = np.column_stack([found.xy_px[frame], found.confidence[frame]])
        person = {"pose_keypoints_2d": [round(float(value), 3) for value in rows.ravel()]}
        file = folder / f"{video}_{number:012d}_keypoints.json"
        file.write_text(json.dumps({"version": 1.3, "people": [person]}))


def _rng(name: str, video: int, purpose: int) -> np.random.Generator:
    digest = hashlib.sha256(name.encode()).digest()
    return np.random.default_rng([SEED, int.from_bytes(digest[:4], "big"), video, purpose])


def _key(name: str, shots: Sequence[Shot], detector: str, params: dict[str, Any]) -> str:
    told = json.dumps([closure(Path(__file__)), name, detector, params], sort_keys=True)
    digest = hashlib.sha256(told.encode())
    for shot in shots:
        world = (shot.R_common_from_stage, shot.t_common)
        for array in (shot.joints_m, shot.phase, shot.kept, *world):
            digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
