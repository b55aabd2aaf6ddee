"""keypoints: detect, with the real worker and a stand-in for the library it calls."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from imocap_core.artifacts.store import Store
from imocap_core.detect import detection
from imocap_core.detect.detection import detect_video, detections_file
from imocap_core.detect.detectors import detector_of
from imocap_core.errors import WorkFailed
from imocap_core.files import publish_once
from imocap_core.io.readers.estimates import PerformerBoxes
from imocap_core.io.readers.keypoint_readers import guess_detections
from imocap_core.io.readers.mediapipe import (
    read_mediapipe,
    read_mediapipe_hands,
    read_mediapipe_world,
)
from imocap_core.params import DetectParams
from tests.detect.conftest import SIZE, clip

COLUMNS = [20, 22, None, 30, 40]


def params(**changes: object) -> DetectParams:
    return replace(DetectParams(), **({"detector": "mediapipe"} | changes))  # type: ignore[arg-type]


def detected(tmp_path: Path, python: Path, **changes: object) -> Path:
    video, file = clip(tmp_path / "bar.mp4", COLUMNS), tmp_path / "out" / "detections.npz"
    shares: list[float] = []
    file.unlink(missing_ok=True)
    detector = detector_of(params(**changes), tmp_path)
    detect_video(video, file, detector, python, lambda share, what: shares.append(share))
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert [p.name for p in file.parent.iterdir()] == ["detections.npz"]
    return file


def test_what_is_written_is_what_the_readers_read(tmp_path: Path, detector_python: Path) -> None:
    file = detected(tmp_path, detector_python)
    assert guess_detections(file) == ("mediapipe", "mediapipe33")
    detections = read_mediapipe(file, "mediapipe33", SIZE)
    assert detections.frames.tolist() == [0, 1, 2, 3, 4]
    assert [len(people) for people in detections.people] == [1, 1, 0, 1, 1]
    for frame in (0, 1, 3, 4):
        column = COLUMNS[frame]
        assert column is not None
        assert abs(detections.people[frame][0, 0, 0] - column) <= 2.5
        assert np.isclose(detections.people[frame][0, 32, 2], 0.82)
    boxes = np.tile([0.0, 0.0, *SIZE], (5, 1))
    world = read_mediapipe_world(file, PerformerBoxes(np.arange(5), boxes, SIZE))
    assert np.isnan(world.joints[2]).all()
    assert np.allclose(world.joints[0, :, 2], 0.01 * np.arange(33))


def test_detections_that_another_run_made_meanwhile_stay(
    tmp_path: Path, detector_python: Path
) -> None:
    """A stage may be reading them."""
    video, file = clip(tmp_path / "bar.mp4", COLUMNS), tmp_path / "out" / "detections.npz"
    file.parent.mkdir()

    def other_run(share: float, what: str) -> None:
        file.write_bytes(b"theirs")

    detect_video(video, file, detector_of(params(), tmp_path), detector_python, other_run)
    assert file.read_bytes() == b"theirs"
    assert [p.name for p in file.parent.iterdir()] == ["detections.npz"]


@pytest.mark.parametrize("has_links", [True, False])
def test_a_file_is_published_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, has_links: bool
) -> None:
    if not has_links:
        monkeypatch.setattr("os.link", refuse)
    for content in (b"first", b"second"):
        draft = tmp_path / "draft"
        draft.write_bytes(content)
        publish_once(draft, tmp_path / "file")
        assert (tmp_path / "file").read_bytes() == b"first"


def refuse(*_: object) -> None:
    raise PermissionError(1, "Operation not permitted")


def test_hands_are_read_where_they_were_asked_for(tmp_path: Path, detector_python: Path) -> None:
    file = detected(tmp_path, detector_python, hands=True)
    hands = read_mediapipe_hands(file, np.array([2, 3]), SIZE)
    assert hands is not None
    xy_px, confidence = hands
    assert confidence.sum(axis=2).tolist() == [[0, 0], [21, 0]]
    assert np.isnan(xy_px[0]).all()
    assert abs(xy_px[1, 0, 0, 0] - 30) <= 2.5
    without = detected(tmp_path, detector_python)
    assert read_mediapipe_hands(without, np.array([2, 3]), SIZE) is None


def test_a_result_is_named_by_all_that_it_depends_on(tmp_path: Path) -> None:
    store = Store(tmp_path / "artifacts")
    videos = [clip(tmp_path / "a.mp4", COLUMNS), clip(tmp_path / "b.mp4", COLUMNS[::-1])]
    again = Path(shutil.copy(videos[0], tmp_path / "c.mp4"))
    settings = ({}, {"hands": True}, {"min_tracking_confidence": 0.7}, {"detector": "rtmlib"})
    names = {
        detections_file(store, video, detector_of(params(**changes), tmp_path))
        for video in videos
        for changes in settings
    }
    assert len(names) == 8
    assert detections_file(store, again, detector_of(params(), tmp_path)) in names
    unused = detector_of(params(rtmlib_mode="performance"), tmp_path)
    assert detections_file(store, videos[0], unused) in names


def test_nobody_is_one_sentence_and_leaves_nothing(tmp_path: Path, detector_python: Path) -> None:
    video = clip(tmp_path / "dark.mp4", [None, None])
    detector = detector_of(params(), tmp_path)
    with pytest.raises(
        WorkFailed, match=r"dark\.mp4: mediapipe 0\.10\.21 found no person in 2 frames"
    ):
        detect_video(video, tmp_path / "o" / "f.npz", detector, detector_python, lambda s, w: None)
    assert not (tmp_path / "o").exists()


def test_a_worker_that_dies_is_one_sentence(
    tmp_path: Path, detector_python: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FAKE_DIES_AT", "2")
    video = clip(tmp_path / "bar.mp4", COLUMNS)
    detector = detector_of(params(), tmp_path)
    with pytest.raises(WorkFailed, match=r"_pose in .* ended without an answer: the model"):
        detect_video(video, tmp_path / "f.npz", detector, detector_python, lambda s, w: None)
    assert not (tmp_path / "f.npz").exists()


def test_a_detector_that_hangs_is_ended(
    tmp_path: Path, detector_python: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FAKE_DIES_AT", "2")
    monkeypatch.setenv("FAKE_HANGS", "1")
    monkeypatch.setattr(detection, "ANSWER_S", 6.0)  # long enough for it to start
    video = clip(tmp_path / "bar.mp4", COLUMNS)
    detector = detector_of(params(), tmp_path)
    with pytest.raises(WorkFailed, match=r"gave no answer for 6 s and was ended"):
        detect_video(video, tmp_path / "f.npz", detector, detector_python, lambda s, w: None)
    assert not (tmp_path / "f.npz").exists()


def test_a_python_without_the_library_is_one_sentence(
    tmp_path: Path, detector_python: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("PYTHONPATH")
    video = clip(tmp_path / "bar.mp4", COLUMNS)
    detector = detector_of(params(), tmp_path)
    with pytest.raises(WorkFailed, match="failed: ModuleNotFoundError: No module named"):
        detect_video(video, tmp_path / "f.npz", detector, detector_python, lambda s, w: None)


def test_settings_reach_the_worker_as_they_are(tmp_path: Path) -> None:
    detector = detector_of(params(min_detection_confidence=0.25), tmp_path)
    assert json.loads(json.dumps(detector.settings))["min_detection_confidence"] == 0.25
    assert detector.version == "mediapipe 0.10.21"
