"""Keypoints of a video, as OpenPose and as the stage `keypoints` write them."""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from imocap_core.artifacts.schemas import VideoKeypoints
from imocap_core.body.layouts import layout_names


def made_keypoints(frames: np.ndarray, layout: str = "body25", **fields: Any) -> VideoKeypoints:
    """A video of these source frames in which nobody was detected, with some fields changed."""
    count, points = len(frames), len(layout_names(layout))
    usual: dict[str, Any] = {
        "id": "v1",
        "fps": 30.0,
        "size": (640, 360),
        "video": None,
        "focal_px": None,
        "initial": None,
        "initial_format": None,
        "xy_px": np.zeros((count, points, 2)),
        "confidence": np.zeros((count, points)),
        "person_box_px": np.zeros((count, 4)),
        "tracks_found": 1,
        "presence": 1.0,
        "note": "",
    }
    return VideoKeypoints(frames=frames, layout=layout, **(usual | fields))


def write_openpose(folder: Path, frames: Iterable[Sequence[np.ndarray]]) -> Path:
    """A file a frame, with its people (K, 3)."""
    folder.mkdir(parents=True, exist_ok=True)
    for t, people in enumerate(frames):
        content = {
            "people": [{"pose_keypoints_2d": np.ravel(person).tolist()} for person in people]
        }
        (folder / f"c_{t:06d}_keypoints.json").write_text(json.dumps(content))
    return folder


def standing_at(x: float, scale: float = 1.0) -> np.ndarray:
    """Somebody's 25 points (25, 3)."""
    spread = np.random.default_rng(0).uniform(-1, 1, (25, 2)) * [30, 80] * scale
    return np.concatenate([spread + (x, 180), np.full((25, 1), 0.9)], axis=1)


def write_walk(folder: Path) -> Path:
    """Twenty frames of a performer who walks, with a smaller bystander who comes first."""
    walk = ([standing_at(500, 0.5), standing_at(100 + 5 * t)] for t in range(20))
    return write_openpose(folder, walk)
