"""Little of another shot at a clip's end is left out; more of it is advised against."""

from pathlib import Path

import numpy as np
import pytest

from imocap_core.adapters.detected_people import tracked_video
from imocap_core.adapters.tracked_people import Faults, left_out_videos, longest_shot, of_usable
from imocap_core.io.video import write_h264
from imocap_core.params import KeypointsParams
from imocap_core.pipeline.action import Declaration
from tests.io import made_keypoints as made

COUNT = 40


@pytest.mark.parametrize(
    ("cuts", "unseen", "declared", "expected"),
    [
        ([], 0, None, (10, 110)),
        ([13, 100], 0, None, (13, 100)),
        ([80], 60, None, (80, 110)),
        ([30, 80], 0, 85, (80, 110)),
        ([30, 80], 0, 5, (30, 80)),
    ],
)
def test_the_shot_of_who_is_declared_or_seen_for_longest_is_used(cuts, unseen, declared, expected):
    people = [int(t >= unseen) for t in range(100)]
    assert longest_shot(cuts, np.arange(10, 110), people, declared) == expected


@pytest.mark.parametrize(("first", "stop"), [(0, 39), (0, 25), (1, 40), (2, 39), (0, 40)])
def test_frames_of_another_shot_are_not_used(tmp_path: Path, first: int, stop: int) -> None:
    rng = np.random.default_rng(0)
    scenes = rng.integers(0, 255, (3, 24, 32, 3), dtype=np.uint8).repeat(8, 1).repeat(8, 2)
    shots = [scenes[0 if t < first else 1 if t < stop else 2] for t in range(COUNT)]
    write_h264(tmp_path / "a.mp4", shots, 25)
    person = made.people("coco17", frames=1, persons=1)[0][0] * (0.6, 0.5, 1)
    moved = {t: [person + (0.3 * t, 0, 0)] for t in range(COUNT)}
    file = made.write_npz(tmp_path, moved)
    declared = Declaration(
        id="v1", video="a.mp4", keypoints="rtmlib.npz", format="npz", layout="coco17"
    )
    video = tracked_video(
        declared, file, tmp_path / "a.mp4", tmp_path / "action.yaml", KeypointsParams()
    )
    assert video.people.frames.tolist() == list(range(first, stop))
    assert len(video.people.people) == stop - first
    assert video.survey.cuts == []
    said = [r for r in video.remarks if r.endswith("of another shot: left out")]
    assert len(said) == (stop - first < COUNT)


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
