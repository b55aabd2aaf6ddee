"""rtmlib itself, where it is installed, with small models of the true input and output form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from imocap_core.body.layouts import layout_names
from imocap_core.detect.detection import detect_video
from imocap_core.detect.detectors import Detector, detector_of, frames_with_people, people_arrays
from imocap_core.detect.environment import FOLDER
from imocap_core.io.readers.keypoint_arrays import read_keypoints_npz
from imocap_core.io.readers.keypoint_readers import guess_detections
from imocap_core.io.video import write_h264
from imocap_core.pipeline.source import PROJECT
from tests.detect.made_onnx import person_model, pose_model
from tests.detect.test_detection import params

ENVIRONMENT = PROJECT / FOLDER
PYTHON = ENVIRONMENT / "bin" / "python"
WIDTH, HEIGHT, SIDE = 64, 48, 416
# Two people in the person model's picture, which shows the video SIDE / WIDTH times as large.
BOXES = np.array([[65.0, 52.0, 195.0, 260.0], [260.0, 65.0, 325.0, 195.0]])

needs_rtmlib = pytest.mark.skipif(
    not (ENVIRONMENT / ".installed-rtmlib.txt").exists(),
    reason="no rtmlib: imocap detect --setup --set detect.detector=rtmlib",
)


def detector(folder: Path, layout: str, **changes: object) -> Detector:
    count = len(layout_names(layout))
    points = np.column_stack([np.linspace(0.2, 0.8, count), np.full(count, 0.5)])
    person_model(folder / "person.onnx", SIDE, BOXES)
    pose_model(folder / "pose.onnx", (192, 256), points)
    models = {"rtmlib_person_model": "person.onnx", "rtmlib_pose_model": "pose.onnx"}
    return detector_of(params(detector="rtmlib", **models, **changes), folder)


@needs_rtmlib
@pytest.mark.parametrize(("hands", "layout"), [(False, "halpe26"), (True, "wholebody133")])
def test_everybody_is_found_where_the_models_say(tmp_path: Path, hands: bool, layout: str) -> None:
    video, file = tmp_path / "clip.mp4", tmp_path / "detections.npz"
    pictures = [np.full((HEIGHT, WIDTH, 3), grey, np.uint8) for grey in (235, 0, 235)]
    write_h264(video, pictures, 30.0)
    chosen = detector(tmp_path, layout, hands=hands)
    assert chosen.layout == layout
    detect_video(video, file, chosen, PYTHON, lambda share, what: None)
    assert guess_detections(file) == ("npz", layout)
    detections = read_keypoints_npz(file, layout)
    assert [len(people) for people in detections.people] == [2, 0, 2]  # nobody in the dark
    for person, box in zip(detections.people[2], BOXES * WIDTH / SIDE, strict=True):
        middle = (box[:2] + box[2:]) / 2
        assert np.abs(person[:, :2].mean(axis=0) - middle).max() < 0.3
        assert np.all(np.diff(person[:, 0]) >= 0)
        assert np.allclose(person[:, 2], 0.75)


def test_a_model_of_ones_own_is_part_of_the_key(tmp_path: Path) -> None:
    chosen = detector(tmp_path, "halpe26")
    assert [path.name for path in chosen.models] == ["person.onnx", "pose.onnx"]
    assert chosen.key("video", ["a", "b"]) != chosen.key("video", ["a", "c"])
    (tmp_path / "elsewhere").mkdir()
    moved = detector(tmp_path / "elsewhere", "halpe26")
    assert chosen.key("video", ["a", "b"]) == moved.key("video", ["a", "b"])


def test_frames_with_fewer_people_are_filled_up() -> None:
    person = [[1.0, 2.0], [3.0, 4.0]]
    answers = [
        {"keypoints": [person, person], "scores": [[0.5, 0.6], [0.7, 0.8]]},
        {"keypoints": [], "scores": []},
        {"keypoints": [person], "scores": [[0.9, 0.4]]},
    ]
    arrays = people_arrays(answers)
    assert arrays["keypoints"].shape == (3, 2, 2, 2)
    assert arrays["scores"].sum(axis=(1, 2)).tolist() == pytest.approx([2.6, 0.0, 1.3])
    assert np.isnan(arrays["keypoints"][2, 1]).all()
    assert frames_with_people(arrays) == 2
    assert frames_with_people(people_arrays([{"keypoints": [], "scores": []}])) == 0
