"""What keypoints are is told by their content, or asked for in one sentence."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from imocap_core.body import load_free_body
from imocap_core.io.readers.keypoint_arrays import read_keypoints_npz
from imocap_core.io.readers.keypoint_readers import guess_detections
from imocap_core.io.readers.mediapipe import read_mediapipe
from imocap_core.io.readers.openpose import read_openpose


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
        (
            [np.ones((25, 3))],
            "fit both about equally; say which with `format` and `layout` in action.yaml",
        ),
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


def test_what_macos_and_windows_add_is_passed_over(tmp_path: Path) -> None:
    """`._NAME` of macOS, a mark at the beginning of UTF-8, and PowerShell's UTF-16."""
    folder = _write(tmp_path / "v1", [np.ones((18, 3))] * 3)
    first, second, third = sorted(folder.glob("*.json"))
    (folder / f"._{first.name}").write_bytes(b"\x00\x05\x16\x07")
    text = second.read_text()
    second.write_text(text, encoding="utf-8-sig")
    third.write_text(text, encoding="utf-16")
    assert guess_detections(folder) == ("openpose", "coco18")
    assert len(read_openpose(folder, "coco18").frames) == 3


def test_world_landmarks_alone_are_named(tmp_path: Path) -> None:
    file = tmp_path / "world.json"
    landmarks = [{"x": 0.1, "y": 0.2, "z": 0.3}] * 33
    file.write_text(json.dumps([{"pose_world_landmarks": [landmarks]}]))
    np.savez(tmp_path / "world.npz", pose_world_landmarks=np.ones((4, 33, 4)))
    for path in (file, tmp_path / "world.npz"):
        assert guess_detections(path) == ("mediapipe", "mediapipe33")
        with pytest.raises(ValueError, match="world landmarks, in metres, and no places in the"):
            read_mediapipe(path, "mediapipe33", (640, 360))


def test_freemocap_of_one_camera_and_of_several(tmp_path: Path) -> None:
    file = tmp_path / "mediapipe2dData_numCams_numFrames_numTrackedPoints_pixelXY.npy"
    points = np.random.default_rng(0).uniform(0, 300, (3, 5, 553, 2))
    points[1, 2, 4] = np.nan
    np.save(file, points)
    assert guess_detections(file) == ("npz", "mediapipe33")
    with pytest.raises(ValueError, match=r"got 3 times 5, as FreeMoCap's .*; save each camera"):
        read_keypoints_npz(file, "mediapipe33")
    np.save(file, points[1])
    read = read_keypoints_npz(file, "mediapipe33")
    assert np.array_equal(np.concatenate(read.people)[..., :2], points[1, :, :33], equal_nan=True)
    assert read.people[2][0, 4, 2] == 0.0
    np.save(file, points[:, :, :33])  # the body alone: not 3 frames of 5 people
    with pytest.raises(ValueError, match="got 3 times 5"):
        read_keypoints_npz(file, "mediapipe33")


def test_an_unknown_file_is_told_what_can_be_read(tmp_path: Path) -> None:
    file = tmp_path / "points.json"
    file.write_text('[{"joints": 3}]')
    with pytest.raises(ValueError, match=r"`imocap formats` lists .*`format` and `layout` in act"):
        guess_detections(file)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("a.slp", "is SLEAP's project; export its analysis"),
        ("a.trc", "is a file of 3D motion"),
        ("results.pkl", "a monocular estimate is given as `initial`"),
        ("a.mp4", "write `keypoints: detect`"),
    ],
)
def test_files_of_other_kinds_are_called_by_their_names(
    name: str, message: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(b"something")
    with pytest.raises(ValueError, match=message):
        guess_detections(tmp_path / name)


def test_a_folder_of_cameras_is_asked_for_one(tmp_path: Path) -> None:
    for camera in ("01", "02"):
        (tmp_path / camera).mkdir()
        (tmp_path / camera / "000000.json").write_text("{}")
    with pytest.raises(ValueError, match="found folders of them; name one: 01, 02"):
        guess_detections(tmp_path)


def test_numbered_points_of_others_are_not_mediapipes(tmp_path: Path) -> None:
    """In a table with a row a point, 17 points are no part of MediaPipe's 33."""
    rows = [f"{t},{k},{10 * k},{t},0.9" for t in range(3) for k in range(17)]
    file = tmp_path / "points.csv"
    file.write_text("\n".join(["frame,keypoint,x,y,score", *rows]))
    with pytest.raises(ValueError, match="expected MediaPipe's 33 landmarks by number or name"):
        read_mediapipe(file, "mediapipe33", (640, 360))
