"""A video that cannot be used is left out and named; too few usable ones are one error."""

from __future__ import annotations

from pathlib import Path

import pytest

from imocap_core.adapters.tracked_people import Faults, left_out_videos, of_usable


def solve(video: str) -> str:
    if video.startswith("bad"):
        raise ValueError(f"/home/me/action.yaml: videos.{video}.size: expected [4, 3]\nand more")
    return video.upper()


def test_the_others_are_solved_in_their_order() -> None:
    faults: Faults = {}
    assert of_usable(["v1", "bad", "v2"], solve, faults) == {"v1": "V1", "v2": "V2"}
    assert list(faults) == ["bad"]
    assert of_usable(["v1"], solve, {}) == {"v1": "V1"}


@pytest.mark.parametrize("ids", [["bad"], ["bad", "v1"], ["bad1", "bad2", "v1"]])
def test_too_few_usable_videos_are_one_error_with_every_fault(ids: list[str]) -> None:
    with pytest.raises(ValueError, match=r"videos\.bad") as error:
        of_usable(ids, solve, {})
    for video in ids:
        assert (f"videos.{video}.size" in str(error.value)) == video.startswith("bad")


def test_reasons_are_one_line_and_name_no_absolute_path() -> None:
    faults: Faults = {"bad": "/home/me/k/v1/x.json: broken\nin /home/me/k"}
    names = {Path("/home/me/k"): "k", Path("/home/me/k/v1"): "keypoints of v1"}
    (video,) = left_out_videos(faults, names) or []
    assert (video.id, video.reason) == ("bad", "keypoints of v1/x.json: broken; in k")
    assert left_out_videos({}, names) is None
