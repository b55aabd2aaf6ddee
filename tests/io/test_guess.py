"""What keypoints are is told by their content, or asked for in one sentence."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from imocap_core.body import load_free_body
from imocap_core.io.detectors.guess import guess_detections


def _write(folder: Path, people: list[np.ndarray]) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for number, person in enumerate(people):
        values = [{"pose_keypoints_2d": person.ravel().tolist()}] if len(person) else []
        file = folder / f"clip_{number:012d}_keypoints.json"
        file.write_text(json.dumps({"people": values}))
    return folder


def _people(layout: str, frames: int = 8) -> list[np.ndarray]:
    """A standing body seen from all sides."""
    model = load_free_body()
    points = model.points(layout)
    posed = model.shape(torch.zeros(10, dtype=torch.float64)).pose(
        torch.eye(3, dtype=torch.float64).expand(24, 3, 3), torch.zeros(3, dtype=torch.float64)
    )
    xyz = posed.keypoints(points).numpy()
    rng = np.random.default_rng(0)
    people = []
    for angle in np.linspace(0, 3, frames):
        x = 200 * (np.cos(angle) * xyz[:, 0] + np.sin(angle) * xyz[:, 2]) + 500
        person = np.zeros((25, 3))
        xy = np.column_stack([x, 400 - 200 * xyz[:, 1]]) + rng.normal(size=(len(xyz), 2))
        person[list(points.columns or range(25))] = np.column_stack([xy, np.full(len(xy), 0.9)])
        people.append(person)
    return people


@pytest.mark.parametrize("layout", ["body25", "body25b"])
def test_the_two_layouts_of_25_points_are_told_apart(layout: str, tmp_path: Path) -> None:
    folder = _write(tmp_path / "v1", [np.zeros((0, 3)), *_people(layout)])
    assert guess_detections(folder) == ("openpose", layout)


def test_the_number_of_points_tells_coco(tmp_path: Path) -> None:
    assert guess_detections(_write(tmp_path / "v1", [np.ones((18, 3))])) == ("openpose", "coco18")


@pytest.mark.parametrize(
    ("people", "message"),
    [
        ([np.ones((25, 3))], "fit both about equally; give --layout"),
        ([np.ones((16, 3))], "18 \\(coco18\\), 25 \\(body25 or body25b\\), 26 \\(halpe26\\)"),
        ([np.ones((18, 3)), np.ones((25, 3))], "got 18, 25; keep one detector's output"),
        ([np.zeros((0, 3))], "nobody was detected"),
    ],
)
def test_what_is_not_clear_is_asked_for(
    people: list[np.ndarray], message: str, tmp_path: Path
) -> None:
    folder = _write(tmp_path / "v1", people)
    with pytest.raises(ValueError, match=message):
        guess_detections(folder)


def test_a_given_layout_is_believed(tmp_path: Path) -> None:
    folder = _write(tmp_path / "v1", [np.ones((25, 3))])
    assert guess_detections(folder, layout="body25b") == ("openpose", "body25b")


def test_files_that_are_something_else(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(ValueError, match=r"found no \.json file"):
        guess_detections(tmp_path / "empty")
    (tmp_path / "odd").mkdir()
    (tmp_path / "odd" / "f0.json").write_text("[1, 2]")
    with pytest.raises(ValueError, match="expected OpenPose's JSON"):
        guess_detections(tmp_path / "odd")
    (tmp_path / "odd" / "f0.json").write_text("{")
    with pytest.raises(ValueError, match="is not JSON"):
        guess_detections(tmp_path / "odd")
    results = tmp_path / "results.json"
    results.write_text(json.dumps([{"image_id": "1.jpg", "keypoints": [], "box": []}]))
    with pytest.raises(ValueError, match="alphapose, but the file does not tell the layout"):
        guess_detections(results)
    assert guess_detections(results, layout="halpe26") == ("alphapose", "halpe26")
