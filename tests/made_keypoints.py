"""Keypoints of a video as the stage `keypoints` writes them; what a test does not name is usual."""

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
