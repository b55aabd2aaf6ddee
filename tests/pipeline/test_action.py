"""action.yaml: every fault is named, with file, field, expected and got, all at once."""

import shutil
from pathlib import Path

import pytest

from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.library.new_action import new_action
from imocap_core.pipeline.action import (
    Action,
    Declaration,
    find_action,
    leads_outside,
    placed,
    read_action,
    repeated_files,
)
from tests.io.made_videos import write_video

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
        (GOOD + "event: perhaps\n", "event: expected a valid boolean"),
        (GOOD.replace("v2", "v1"), "videos: expected unique ids, got v1 twice"),
        (GOOD.replace("[0, 120]", "[9, 9]"), "frames: expected [first, one past last], got [9, 9]"),
        (GOOD.replace("[0, 120]", "abc"), "videos.1.frames: expected a list, got 'abc'"),
        (GOOD.replace("openpose", "openpoze"), "videos.0.format: expected 'openpose'"),
        (GOOD.replace("focal_px: null", "focal_px: -3"), "videos.1.focal_px: expected"),
        (GOOD.replace("focal_px", "focal"), "focal: unknown field. Did you mean focal_px?"),
        (GOOD.replace("video: b.mp4, ", ""), "videos.1: expected a video"),
        (GOOD.replace("body25", "body26"), "videos.0.layout: expected"),
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


def video(name: str, path: str, **more: str) -> Declaration:
    return Declaration(id=name, video=path, keypoints="detect", **more)


@pytest.mark.parametrize(
    ("path", "outside"),
    [
        ("videos/v1.mp4", False),
        ("a/../v1.mp4", False),
        ("..v1.mp4", False),
        ("../v1.mp4", True),
        ("a/../../v1.mp4", True),
        ("/films/v1.mp4", True),
        ("C:/films/v1.mp4", True),
        ("..\\films\\v1.mp4", True),
    ],
)
def test_what_leads_outside(path: str, outside: bool) -> None:
    assert leads_outside(path) is outside


def test_inside_nothing_changes_and_twice_is_as_once() -> None:
    inside = (video("v1", "clip.mp4"), video("v2", "videos/v2.mp4", performer="anna"))
    assert placed(inside) == inside
    moved = placed((video("v1", "../x/clip.mp4"), video("v2", "/y/clip.mp4")))
    assert [v.video for v in moved] == ["videos/clip.mp4", "videos/v2_clip.mp4"]
    assert [v.keypoints for v in moved] == ["detect", "detect"]
    assert placed(moved) == moved


def test_places_that_are_taken() -> None:
    videos = (
        video("v1", "../Clip.mp4"),
        video("v2", "../other/clip.mp4"),
        video("v3", "../Clip.mp4"),
        video("v4", "videos/v2_clip.mp4"),
    )
    names = [v.video for v in placed(videos)]
    assert names[0] == names[2] == "videos/Clip.mp4"  # one file, one place
    assert names[1] == "videos/v2_v2_clip.mp4"
    assert names[3] == "videos/v2_clip.mp4"


def action(folder: Path, *frames: tuple[int, int] | None) -> Action:
    """Videos a, b, ... of equal content, and one of another."""
    for name in "abcdx"[: len(frames)]:
        (folder / f"{name}.mp4").write_bytes(b"the same")
    (folder / "other.mp4").write_bytes(b"another")
    videos = [
        Declaration(id=name, video=f"{name}.mp4", keypoints="detect", frames=span)
        for name, span in zip("abcdx", frames, strict=False)
    ]
    videos.append(Declaration(id="other", video="other.mp4", keypoints="detect"))
    return Action(folder, "made", tuple(videos))


@pytest.mark.parametrize(
    ("spans", "count"),
    [
        ((None, None), 1),
        ((None, (0, 9)), 1),
        (((0, 10), (9, 20)), 1),
        (((0, 10), (10, 20)), 0),  # two parts of a long clip
        ((None, None, None), 3),
    ],
)
def test_equal_content_with_common_frames_is_reported(tmp_path, spans, count):
    lines = repeated_files(action(tmp_path, *spans))
    assert len(lines) == count
    assert all("is the same file as a" in line or "as b" in line for line in lines)
    assert not any("other" in line for line in lines)


def test_init_reports_equal_files(tmp_path: Path) -> None:
    files = [write_video(tmp_path / f"{name}.mp4", count=n) for name, n in (("a", 8), ("x", 5))]
    files.append(Path(shutil.copy(files[0], tmp_path / "b.mp4")))
    (remark,) = new_action("mine", files, tmp_path).remarks
    assert remark.startswith(f"{files[2]} is the same file as {files[0]}")
