"""action.yaml: every fault is named, with file, field, expected and got, all at once."""

from __future__ import annotations

from pathlib import Path

import pytest

from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.pipeline.action import find_action, read_action

GOOD = """\
name: yoga
videos:
  - {id: v1, video: videos/v1.mp4, keypoints: keypoints/v1, format: openpose, layout: body25}
  - {id: v2, keypoints: detect, video: b.mp4, frames: [0, 120], focal_px: null}
"""


def write(folder: Path, text: str) -> Path:
    (folder / "action.yaml").write_text(text)
    return folder


def test_a_good_action(tmp_path: Path) -> None:
    action = read_action(write(tmp_path, GOOD))
    assert action.name == "yoga"
    assert action.file == tmp_path / "action.yaml"
    assert [v.frames for v in action.videos] == [None, (0, 120)]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("name: [", "is not YAML"),
        ("- 1", "expected fields like 'name: value', got [1]"),
        ("name: yoga", "action.yaml: videos: is missing"),
        (
            GOOD.replace("id: v2", "id: v2, performer: A"),
            "performer: expected of every video or of none, got none of v1",
        ),
        (GOOD + "event: perhaps\n", "event: Input should be a valid boolean"),
        (GOOD.replace("v2", "v1"), "videos: expected unique ids, got v1 twice"),
        (
            GOOD.replace("[0, 120]", "[9, 9]"),
            "videos.1: frames: expected [first, one past last], got [9, 9]",
        ),
        (GOOD.replace("openpose", "openpoze"), "videos.0.format: Input should be 'openpose'"),
        (GOOD.replace("focal_px: null", "focal_px: -3"), "videos.1.focal_px: Input should be"),
        (GOOD.replace("focal_px", "focal"), "videos.1.focal: unknown field"),
        (GOOD.replace("video: b.mp4, ", ""), "videos.1: expected a video"),
        (GOOD.replace("body25", "body26"), "videos.0.layout: Input should be"),
        (
            GOOD.replace("video: videos/v1.mp4, ", ""),
            "fps and size: expected where there is no video",
        ),
        (
            GOOD.replace("focal_px: null", "initial: a.npz"),
            "initial_format: expected where initial is given",
        ),
        (GOOD.replace("name: yoga", "name: ../yoga"), "name: String should match"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(WorkFailed) as caught:
        read_action(write(tmp_path, text))
    assert said in str(caught.value)
    assert str(tmp_path / "action.yaml") in str(caught.value)


def test_all_faults_at_once(tmp_path: Path) -> None:
    with pytest.raises(WorkFailed) as caught:
        read_action(write(tmp_path, GOOD.replace("openpose", "x").replace("0, 120", "9, 2")))
    assert len(str(caught.value).splitlines()) == 2


def test_an_action_is_found_by_name_or_path(tmp_path: Path) -> None:
    folder = tmp_path / "actions" / "yoga"
    folder.mkdir(parents=True)
    write(folder, GOOD)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    write(elsewhere, GOOD)
    assert find_action("yoga", tmp_path) == folder
    assert find_action(str(elsewhere), tmp_path) == elsewhere
    assert find_action(str(elsewhere / "action.yaml"), tmp_path) == elsewhere
    with pytest.raises(WrongUse, match="Existing actions: yoga"):
        find_action("dance", tmp_path)
