"""One video file given twice is noticed by its content."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from imocap_core.library.new_action import new_action
from imocap_core.pipeline.action import Action, Declaration, repeated_files
from tests.io.made_videos import write_video


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
def test_equal_content_with_common_frames_is_reported(
    tmp_path: Path, spans: tuple[tuple[int, int] | None, ...], count: int
) -> None:
    lines = repeated_files(action(tmp_path, *spans))
    assert len(lines) == count
    assert all("is the same file as a" in line or "as b" in line for line in lines)
    assert not any("other" in line for line in lines)


def test_init_reports_equal_files(tmp_path: Path) -> None:
    files = [write_video(tmp_path / f"{name}.mp4", count=n) for name, n in (("a", 8), ("x", 5))]
    files.append(Path(shutil.copy(files[0], tmp_path / "b.mp4")))
    (remark,) = new_action("mine", files, tmp_path).remarks
    assert remark.startswith(f"{files[2]} is the same file as {files[0]}")
