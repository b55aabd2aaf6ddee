"""A stand-in for MediaPipe in the place of the real one: the worker itself is the real one.

It finds a person whose 33 landmarks spread about the brightest column of the picture, and nobody in
black pictures.
"""

import sys
from pathlib import Path

import numpy as np
import pytest

from imocap_core.io.video import write_h264

SIZE = (64, 48)
MEDIAPIPE = """
from types import SimpleNamespace as Bunch
import os, time
import numpy as np

print("a library that talks")
HALF = os.environ.get("FAKE_DIES_AT")

def points(count, x, visible):
    return Bunch(landmark=[
        Bunch(x=x + 0.001 * k, y=0.2 + 0.015 * k, z=0.01 * k, visibility=0.5 + 0.01 * k)
        for k in range(count)
    ])

class Model:
    def __init__(self, **options):
        self.options, self.calls = options, 0
    def __enter__(self):
        return self
    def __exit__(self, *error):
        pass
    def process(self, picture):
        if HALF and self.calls == int(HALF):
            if os.environ.get("FAKE_HANGS"):
                time.sleep(3600)
            raise SystemExit("the model died")
        self.calls += 1
        if picture.max() < 40:
            return Bunch(**dict.fromkeys((
                "pose_landmarks", "pose_world_landmarks",
                "left_hand_landmarks", "right_hand_landmarks")))
        x = float(picture.sum(axis=(0, 2)).argmax()) / picture.shape[1]
        return Bunch(
            pose_landmarks=points(33, x, True), pose_world_landmarks=points(33, x - 0.5, True),
            left_hand_landmarks=points(21, x, False), right_hand_landmarks=None)

solutions = Bunch(pose=Bunch(Pose=Model), holistic=Bunch(Holistic=Model))
"""


@pytest.fixture
def detector_python(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """This Python, with a stand-in for mediapipe."""
    library = tmp_path / "library"
    library.mkdir()
    (library / "mediapipe.py").write_text(MEDIAPIPE)
    monkeypatch.setenv("PYTHONPATH", str(library))
    monkeypatch.setenv("IMOCAP_DETECT_PYTHON", sys.executable)
    return Path(sys.executable)


def clip(file: Path, columns: list[int | None]) -> Path:
    """A video of such pictures."""
    file.parent.mkdir(parents=True, exist_ok=True)
    pictures = []
    for column in columns:
        picture = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
        if column is not None:
            picture[:, column - 2 : column + 3] = 255
        pictures.append(picture)
    write_h264(file, pictures, 30.0)
    return file
