"""BlazePose's parts, with networks that are functions: where crops lie, what outputs mean."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest

from imocap_core.detect.detection import detect_video
from imocap_core.detect.detectors import Detector, detector_of
from imocap_core.detect.workers.blazepose.boxes import (
    anchors,
    box_anchors,
    detect_boxes,
    detect_people,
)
from imocap_core.detect.workers.blazepose.landmarks import (
    MARGIN,
    POINTS,
    Crop,
    Pyramid,
    about,
    detect_landmarks,
    pixels,
    refined,
    upright_about,
    whole,
)
from imocap_core.errors import WorkFailed
from imocap_core.io.readers.mediapipe import read_mediapipe
from imocap_core.params import DetectParams
from tests.detect.conftest import SIZE as BAR_SIZE
from tests.detect.conftest import clip
from tests.detect.made_people import COLD, Network, box_network, picture
from tests.detect.test_detection import params

BLACK = Pyramid(np.zeros((300, 200, 3), np.uint8))


def slope(height: int, width: int) -> np.ndarray:
    """A picture whose red is its column, green its row and blue the column from its right side, in
    quarters."""
    y, x = np.mgrid[:height, :width]
    return np.stack([x / 4, y / 4, (width - x) / 4], axis=-1).round().astype(np.uint8)


@pytest.mark.parametrize("angle", [0.0, 0.4, -2.0])
@pytest.mark.parametrize("side", [64.0, 200.0, 700.0])
def test_a_crop_s_pixels_are_the_picture_s_at_its_points(angle: float, side: float) -> None:
    crop = Crop(430.0, 510.0, side, angle)
    cut = pixels(Pyramid(slope(1001, 1000)), crop, 64).astype(float)
    centres = (np.stack(np.meshgrid(*[np.arange(64)] * 2), axis=-1) + 0.5) / 64
    there = crop.in_picture(centres) - 0.5  # of the pixel whose centre it is
    inside = ((there > 8) & (there < 991)).all(axis=-1)
    off = (cut - np.concatenate([there, 1000 - there[..., :1]], axis=-1) / 4)[inside]
    assert np.abs(off).max() < 1.7
    assert np.abs((off[:, 0] - off[:, 2]).mean()) < 0.3  # what is rounded up is so in both


def test_a_body_stands_upright_in_its_crop() -> None:
    crop = about(np.array([50.0, 80.0]), np.array([90.0, 80.0]))  # it lies, its head to the right
    assert np.allclose(crop.in_picture(np.array([0.5, 0.5])), [50, 80])
    assert np.allclose(crop.in_picture(np.array([0.5, 0.5 - 0.5 / MARGIN])), [90, 80])
    assert whole(300, 200) == Crop(100.0, 150.0, 300.0, 0.0)


def test_a_box_s_crop_is_the_square_about_it_with_a_margin() -> None:
    crop = upright_about(np.array([[10.0, 20.0], [50.0, 100.0]]))
    assert crop == Crop(30.0, 60.0, 80 * MARGIN, 0.0)


def test_everybody_is_in_one_box_the_most_confident_first() -> None:
    made = Pyramid(picture((100, 120), (400, 250)))
    people = detect_boxes(made, box_network([0.6, 0.9]), 0.5)
    assert [round(person.confidence, 3) for person in people] == [0.9, 0.6]
    assert np.allclose(people[0].corners, [[380, 190], [420, 310]], atol=3)
    assert np.allclose(people[1].corners, [[80, 60], [120, 180]], atol=3)
    assert len(detect_boxes(made, box_network([0.6, 0.4]), 0.5)) == 1
    assert detect_boxes(BLACK, box_network(), 0.5) == []


def test_anchors_lie_in_the_picture_and_have_the_area_of_their_layer() -> None:
    anchors = box_anchors()
    assert anchors.shape == (1917, 4)
    assert ((anchors[:, :2] > 0) & (anchors[:, :2] < 1)).all()
    area = np.sqrt(anchors[:, 2] * anchors[:, 3])
    assert np.all(np.diff(area[[0, 1, 19 * 19 * 3, -1]]) > 0)


def people_at(*places: tuple[float, float, float]) -> Network:
    """Detects people standing at x, y (shares of the square), each by two boxes; with a logit."""

    def network(given: np.ndarray) -> list[np.ndarray]:
        assert given.shape == (224, 224, 3)
        assert given.min() >= -1
        values, logits = np.zeros((len(anchors()), 12), np.float32), np.full((2254, 1), -100.0)
        for x, y, logit in places:
            for anchor in np.argsort(np.linalg.norm(anchors() - [x, y], axis=1))[:2]:
                dx, dy = 224 * (np.array([x, y]) - anchors()[anchor])
                values[anchor] = [dx, dy, 40, 60, dx, dy, dx, dy - 50, dx, dy, dx, dy]
                logits[anchor] = logit
        return [values, logits]

    return network


def test_blazepose_s_own_detector_has_everybody_once() -> None:
    people = detect_people(
        BLACK, people_at((0.4, 0.5, 1.0), (0.6, 0.5, 3.0), (0.2, 0.2, -3.0)), 0.5
    )
    assert [round(person.confidence, 3) for person in people] == [0.953, 0.731]
    crop = people[0].crop  # the square of 300 pixels begins 50 pixels left of the picture
    assert np.allclose([crop.x, crop.y, crop.angle], [0.6 * 300 - 50, 150, 0], atol=1e-4)
    assert np.isclose(crop.side, 2 * MARGIN * 50 / 224 * 300)
    assert detect_people(BLACK, people_at(), 0.5) == []


def body(presence: float = 1.0, visibility: float = 5.0, dx: float = 0.0) -> Network:
    """A body whose points lie on a line, `dx` pixels of the crop from its middle."""

    def network(given: np.ndarray) -> list[np.ndarray]:
        assert given.shape == (256, 256, 3)
        rows = np.zeros((POINTS, 5), np.float32)
        rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 3] = 128 + dx, 128, 16, visibility
        rows[:, 1] += np.arange(POINTS)
        rows[33, 1], rows[34, 1] = 128, 128 - 256 * 0.5 / MARGIN
        world = np.tile(np.float32([0.1, 0.2, 0.3]), POINTS)
        return [rows.ravel(), np.float32([presence]), np.zeros((256, 256, 1)), COLD, world]

    return network


def test_landmarks_turn_with_the_crop() -> None:
    crop = Crop(100.0, 120.0, 128.0, math.pi / 2)  # the head points to the right
    answer = detect_landmarks(BLACK, crop, body())
    assert np.allclose(answer.xy_px[:, 0], 100 - np.arange(33) / 2)
    assert np.allclose(answer.xy_px[:, 1], 120)
    assert np.allclose(answer.z_px, 16 / 256 * 128)
    assert np.allclose(answer.world_m, [-0.2, 0.1, 0.3])
    assert np.allclose(answer.visibility, 1 / (1 + math.exp(-5)))
    following = answer.next_crop
    assert np.allclose([following.x, following.y], [crop.x, crop.y])
    assert np.allclose([following.side, following.angle], [crop.side, crop.angle])


def test_a_point_moves_to_the_heat_near_it() -> None:
    heat = np.full((64, 64, 3), -20.0)
    heat[30, 41, 0] = heat[30, 42, 0] = 6.0
    heat[50, 41, 1] = 6.0  # too far away
    points = np.array([[0.66, 0.5], [0.66, 0.5], [1.4, 0.5]])
    moved = refined(points, heat)
    assert np.allclose(moved[0], [41.5 / 64, 30 / 64], atol=1e-6)
    assert np.allclose(moved[1:], points[1:])


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
