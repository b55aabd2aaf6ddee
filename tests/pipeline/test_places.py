"""Files of videos get places inside the action's folder, whatever their paths are."""

from __future__ import annotations

import pytest

from imocap_core.pipeline.action import Declaration, leads_outside, placed


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
