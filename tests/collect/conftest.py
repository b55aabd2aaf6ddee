"""A film of five shots whose people are in the cache of detections already."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from imocap_core.detect.detection import detections_file
from imocap_core.detect.detectors import detector_of
from imocap_core.io.video import write_h264
from imocap_core.params import DetectParams
from imocap_core.workspace import Workspace
from tests.collect.made_people import landmarks
from tests.collect.made_shots import place

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
