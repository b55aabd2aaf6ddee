"""An action whose keypoints are to be detected, through the command line."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from imocap_core.artifacts.schemas import Keypoints
from imocap_core.artifacts.store import Store
from imocap_core.cli import main
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.errors import WorkFailed
from imocap_core.pipeline.action import read_action
from tests.detect.conftest import clip
from tests.io.damaged_video import write_damaged

STAND_IN = ("--set", "detect.detector=mediapipe")
Capture = pytest.CaptureFixture[str]


class Place:
    """A working folder with an action of two short clips, and the command line in it."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.folder = root / "actions" / "mine"
        clip(self.folder / "a.mp4", [20, 22, 24, 26, 28])
        clip(self.folder / "b.mp4", [30, 32, 34])
        self.declare({"keypoints": "detect"}, {"keypoints": "detect"})

    def declare(self, *videos: dict[str, object], **settings: object) -> None:
        """Two videos, and settings of detection."""
        named = [
            {"id": name, "video": f"{name}.mp4", **declared}
            for name, declared in zip("ab", videos, strict=False)
        ]
        params = {"detect": {"detector": "mediapipe"} | settings}
        content = {"name": "mine", "videos": named, "params": params}
        (self.folder / "action.yaml").write_text(yaml.safe_dump(content))

    def run(self, *words: str) -> int:
        return main([*words, "--root", str(self.root)])

    def keypoints(self) -> Keypoints:
        stored = Store(self.root / "artifacts").load("mine", "keypoints")
        return stored.decode(Keypoints)


@pytest.fixture
def place(tmp_path: Path, detector_python: Path) -> Place:
    return Place(tmp_path / "work")


def test_from_videos_to_keypoints_and_not_twice(place: Place, capsys: Capture) -> None:
    assert place.run("run", "mine", "--until", "keypoints", "--verbose") == 0
    assert capsys.readouterr().out.count("has no detections of mediapipe 0.10.21") == 2
    a, b = place.keypoints().videos
    assert (a.layout, len(a.frames), len(b.frames)) == ("mediapipe33", 5, 3)
    assert (a.initial, a.initial_format) == (None, None)
    assert np.abs(a.xy_px[:, 0, 0] - [20, 22, 24, 26, 28]).max() <= 2.5
    assert place.run("run", "mine", "--until", "keypoints", "--verbose") == 0
    out = capsys.readouterr().out
    assert "has no detections" not in out
    assert "cached" in out


def test_it_works_where_it_stands(place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without --root: all paths begin in the present folder."""
    monkeypatch.chdir(place.root)
    assert main(["run", "mine", "--until", "keypoints"]) == 0
    assert len(place.keypoints().videos) == 2


def test_what_was_finished_before_a_break_is_kept(place, capsys, monkeypatch):
    clip(place.folder / "b.mp4", [None] * 3)
    assert place.run("detect", "mine") == 1
    assert "b.mp4: mediapipe 0.10.21 found no person" in capsys.readouterr().err
    clip(place.folder / "b.mp4", [30, 32, 34])
    assert place.run("detect", "mine") == 0
    assert capsys.readouterr().out.count(".npz") == 2


def test_status_before_and_after(place: Place, capsys: Capture) -> None:
    assert place.run("status", "mine") == 0
    assert "keypoints      would run  never run" in capsys.readouterr().out
    place.run("run", "mine", "--until", "keypoints")
    capsys.readouterr()
    place.run("status", "mine")
    assert capsys.readouterr().out.startswith("keypoints      cached")
    clip(place.folder / "a.mp4", [40, 40, 40])
    place.run("status", "mine")
    assert "read: detections a is gone" in capsys.readouterr().out


def test_world_landmarks_come_with_the_keypoints_and_an_estimate_stays(place: Place) -> None:
    initial = {"initial": "own.npz", "initial_format": "joints_npz"}
    joints = np.random.default_rng(0).normal(0, 0.4, (5, 24, 3))
    np.savez(place.folder / "own.npz", joints=joints, joint_names=np.array(SMPL_JOINTS))
    place.declare({"keypoints": "detect", **initial}, {"keypoints": "detect"})
    assert place.run("run", "mine", "--until", "keypoints") == 0
    own, other = place.keypoints().videos
    assert (own.initial_format, other.initial_format) == ("joints_npz", None)
    assert np.isfinite(other.joints_m).all(-1).sum() > 0


def test_hands_are_found_when_the_action_wants_them(place: Place) -> None:
    place.declare({"keypoints": "detect"}, hands=True)
    assert place.run("run", "mine", "--until", "keypoints") == 0
    hands = place.keypoints().videos[0].hands
    assert hands.confidence.sum(axis=(0, 2)).tolist() == [5 * 21, 0]


def test_a_missing_video_is_one_sentence(place: Place, capsys: Capture) -> None:
    (place.folder / "b.mp4").unlink()
    assert place.run("run", "mine") == 1
    err = capsys.readouterr().err
    assert "videos.1.video: there is no" in err
    assert err.count("\n") == 1


def add_broken_video(place: Place) -> None:
    write_damaged(place.folder / "c.mp4", 20, 8, 12, unreadable=True)
    content = yaml.safe_load((place.folder / "action.yaml").read_text())
    content["videos"].append({"id": "c", "video": "c.mp4", "keypoints": "detect"})
    (place.folder / "action.yaml").write_text(yaml.safe_dump(content))


def test_a_broken_video_is_named_and_the_others_are_detected(place: Place, capsys: Capture) -> None:
    add_broken_video(place)
    assert place.run("detect", "mine") == 0
    lines = capsys.readouterr().out.replace("\n", "")
    assert "c cannot be used: " in lines
    assert "c.mp4: broken, decoding failed after" in lines
    assert place.run("people", "mine") == 0
    lines = capsys.readouterr().out.replace("\n", "")
    assert "c cannot be used: " in lines
    assert "a: " in lines


def test_a_broken_video_is_given_to_the_detector_once(place, monkeypatch):
    add_broken_video(place)
    assert place.run("detect", "mine") == 0
    monkeypatch.setattr("imocap_core.detect.detected_action.detect_videos", None)
    assert place.run("detect", "mine") == 0


def test_too_few_whole_videos_is_one_sentence(place: Place, capsys: Capture) -> None:
    write_damaged(place.folder / "b.mp4", 20, 8, 12, unreadable=True)
    assert place.run("detect", "mine") == 1
    assert "b.mp4: broken, decoding failed after" in capsys.readouterr().err.replace("\n", "")


def test_init_writes_an_action_that_runs(place: Place) -> None:
    clips = [str(place.folder / f"{name}.mp4") for name in "ab"]
    assert place.run("init", "fresh", *clips) == 0
    action = read_action(place.root / "actions" / "fresh")
    assert [v.keypoints for v in action.videos] == ["detect", "detect"]
    assert place.run("run", "fresh", "--until", "keypoints", *STAND_IN) == 0


def test_detect_needs_an_action_or_setup(place: Place, capsys: Capture) -> None:
    assert place.run("detect") == 2
    assert "imocap detect ACTION" in capsys.readouterr().err
    assert place.run("detect", "--setup", *STAND_IN) == 0
    assert "mediapipe 0.10.21 runs in" in capsys.readouterr().out


def test_initial_detect_goes_with_keypoints_detect(place: Place) -> None:
    place.declare({"keypoints": "some.json", "initial": "detect"})
    with pytest.raises(WorkFailed, match="initial: detect requires keypoints: detect"):
        read_action(place.folder)
