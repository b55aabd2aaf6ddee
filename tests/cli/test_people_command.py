"""`imocap people` lists everybody with the numbers and boxes that action.yaml takes."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imocap_core.errors import WorkFailed
from imocap_core.library.person_summary import VideoPeople
from imocap_core.library.tracked_people import people_of
from imocap_core.pipeline.action import Action, Declaration
from tests.pipeline.test_people import PARAMS


def figure(x: float, scale: float = 1.0) -> dict[str, list[float]]:
    spread = np.random.default_rng(0).uniform(-1, 1, (25, 2)) * [30, 80] * scale
    points = np.concatenate([spread + (x, 180), np.full((25, 1), 0.9)], axis=1)
    return {"pose_keypoints_2d": points.ravel().tolist()}


def declared(folder: Path, name: str, **changes: Any) -> Declaration:
    """A performer who walks, and a smaller bystander."""
    detections = folder / name
    detections.mkdir()
    for t in range(20):
        people = [figure(500, 0.5), figure(100 + 5 * t)]
        (detections / f"{name}_{t:012d}_keypoints.json").write_text(json.dumps({"people": people}))
    fields = {
        "id": name, "keypoints": name, "format": "openpose", "layout": "body25",
        "fps": 30.0, "size": (640, 360), "frames": (4, 20),
    }  # fmt: skip
    return Declaration(**(fields | changes))


def people(folder: Path, **changes: Any) -> list[VideoPeople]:
    action = Action(folder, "made", (declared(folder, "v1", **changes),))
    return people_of(action, PARAMS)


def test_everybody_is_listed_the_performer_first(tmp_path: Path) -> None:
    (video,) = people(tmp_path)
    first, second = video.tracks
    assert (first.number, second.number) == (1, 2)
    assert (first.first_frame, first.last_frame) == (4, 19)
    assert first.score == 1
    assert second.score < 1
    assert first.box_frame == 12
    assert "2 people followed" in video.notes[0]


def test_a_name_from_the_list_is_taken(tmp_path: Path) -> None:
    (video,) = people(tmp_path, person={"track": 2})
    assert "track 2 is the performer as action.yaml declares" in video.notes[0]


def test_a_wrong_person_is_named_beside_everybody_there_is(tmp_path: Path) -> None:
    (video,) = people(tmp_path, person={"track": 5})
    assert [track.number for track in video.tracks] == [1, 2]
    assert "videos.v1.person: track: expected 1 to 2, got 5" in str(video.fault)


def test_one_bad_video_is_named_and_the_others_are_listed(tmp_path: Path) -> None:
    good = declared(tmp_path, "v1")
    bad = (
        declared(tmp_path, "small", size=(6400, 3600)),
        declared(tmp_path, "short", frames=(4, 90)),
        declared(tmp_path, "gone", keypoints="elsewhere"),
    )
    videos = people_of(Action(tmp_path, "made", (good, *bad)), PARAMS)
    assert [(video.id, len(video.tracks)) for video in videos] == [
        ("v1", 2), ("small", 2), ("short", 0), ("gone", 0)
    ]  # fmt: skip
    assert videos[0] == people_of(Action(tmp_path, "made", (good,)), PARAMS)[0]
    expected = ("6400 x 3600", "videos.short.frames", "elsewhere")
    for video, words in zip(videos[1:], expected, strict=True):
        assert words in str(video.fault)
    with pytest.raises(WorkFailed, match="elsewhere"):
        people_of(Action(tmp_path, "made", bad[2:]), PARAMS)
