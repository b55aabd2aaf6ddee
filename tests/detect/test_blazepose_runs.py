"""BlazePose's script, with a stand-in for the networks' runtime."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from imocap_core.detect.detection import detect_video
from imocap_core.detect.detectors import Detector, detector_of
from imocap_core.errors import WorkFailed
from imocap_core.io.readers.mediapipe import read_mediapipe
from imocap_core.params import DetectParams
from tests.detect.conftest import SIZE as BAR_SIZE
from tests.detect.conftest import clip
from tests.detect.test_detection import params

RUNTIME = """
import numpy as np
print("a library that talks")

class Interpreter:
    def __init__(self, model_path, num_threads):
        self.boxes = "objectron" in model_path
        self.person = "assets" in model_path and not self.boxes
    def allocate_tensors(self):
        pass
    def get_input_details(self):
        return [{"index": 0}]
    def get_output_details(self):
        return [{"index": k} for k in range(2 if self.boxes or self.person else 5)]
    def set_tensor(self, index, value):
        assert value.dtype == np.float32
        self.given = value[0]
    def invoke(self):
        bright = self.given.max() > 0.5
        if self.boxes:
            logits = np.full((1917, 24), -9.0, np.float32)
            logits[1900, 4] = 9 if bright else -9
            self.results = [np.zeros((1917, 4), np.float32), logits]
        elif self.person:
            self.results = [np.zeros((2254, 12), np.float32), np.full((2254, 1), -9, np.float32)]
        else:
            points = np.zeros((39, 5), np.float32)
            points[:, :2] = 128, 64
            points[33, :2], points[34, :2] = (128, 128), (128, 26)
            self.results = [points.ravel(), np.float32([bright]), np.zeros((256, 256, 1)),
                            np.full((64, 64, 39), -9, np.float32), np.zeros(117, np.float32)]
    def get_tensor(self, index):
        return self.results[index][None]
"""
REAL = detector_of(params(detector="blazepose", second_network=False), Path())


@pytest.fixture
def made_runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """This Python, with a stand-in for ai-edge-litert."""
    library = tmp_path / "library" / "ai_edge_litert"
    library.mkdir(parents=True)
    (library / "__init__.py").touch()
    (library / "interpreter.py").write_text(RUNTIME)
    monkeypatch.setenv("PYTHONPATH", str(library.parent))
    return Path(sys.executable)


def landmarks(tmp_path: Path, python: Path, detector: Detector) -> Path:
    file = tmp_path / "out" / "detections.npz"
    video = clip(tmp_path / "bar.mp4", [None, 20, 22, None])
    detect_video(video, file, detector, python, lambda share, what: None)
    return file


def test_what_is_written_is_what_the_readers_read(tmp_path: Path, made_runtime: Path) -> None:
    file = landmarks(tmp_path, made_runtime, REAL)
    detections = read_mediapipe(file, "mediapipe33", BAR_SIZE)
    assert [len(people) for people in detections.people] == [0, 1, 1, 0]
    first = detections.people[1][0]
    assert np.allclose(first[:, 2], 0.5)
    assert np.ptp(first[:, :2], axis=0).max() == 0
    assert (np.abs(first[0, :2] - np.array(BAR_SIZE) / 2) < np.array(BAR_SIZE) / 2).all()


def test_a_runtime_that_is_missing_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(WorkFailed, match=r"blazepose_pose in .* failed: ModuleNotFoundError"):
        landmarks(tmp_path, Path(sys.executable), REAL)


def test_its_version_names_the_runtime_s() -> None:
    assert REAL.version.startswith("blazepose (ai-edge-litert ")
    one = {"box_model", "person_model", "landmark_model"}
    assert set(REAL.arguments) - set(REAL.settings) == one
    both = detector_of(DetectParams(), Path())
    assert set(both.arguments) - set(both.settings) == one | {"second_graph", "second_weights"}
    assert both.key("content", []) != REAL.key("content", [])


def test_hands_choose_another_detector_or_are_refused() -> None:
    assert detector_of(DetectParams(second_network=False), Path()) == REAL
    assert detector_of(DetectParams(hands=True), Path()).name == "mediapipe"
    with pytest.raises(WorkFailed, match="blazepose detects no hands"):
        detector_of(params(detector="blazepose", hands=True), Path())
