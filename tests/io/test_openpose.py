"""OpenPose folders: read as written, refused with a sentence when malformed."""

import json
from pathlib import Path

import numpy as np
import pytest

from imocap_core.io.readers.json_people import read_openpose, read_openpose_hands


def write(folder, number, people):
    folder.mkdir(exist_ok=True)
    content = {"version": 1.3, "people": [{"pose_keypoints_2d": values} for values in people]}
    file = folder / f"clip_{number:012d}_keypoints.json"
    file.write_text(json.dumps(content))
    return file


def body(points=25, x=10.0):
    return [value for k in range(points) for value in (x + k, 20.0 + k, 0.5)]


def test_frames_people_and_points_keep_their_places(tmp_path):
    write(tmp_path, 3, [body(), body(x=200.0)])
    write(tmp_path, 5, [])
    detected = read_openpose(tmp_path, "body25")
    assert detected.frames.tolist() == [3, 5]
    assert [len(people) for people in detected.people] == [2, 0]
    assert detected.people[0][1, 4].tolist() == [204.0, 24.0, 0.5]


def test_a_person_with_only_hands_is_no_body(tmp_path):
    write(tmp_path, 0, [[], body()])
    assert len(read_openpose(tmp_path, "body25").people[0]) == 1


def test_broken_files_are_all_named_at_once(tmp_path):
    write(tmp_path, 0, [body()])
    (tmp_path / "clip_1_keypoints.json").write_text('{"people": [')
    (tmp_path / "clip_2_keypoints.json").write_text('{"persons": []}')
    (tmp_path / "clip_3_keypoints.json").write_text('{"people": [{"pose_keypoints_2d": [0.5]}]}')
    write(tmp_path, 4, [["x"] * 75])
    with pytest.raises(ValueError, match="is not JSON") as error:
        read_openpose(tmp_path, "body25")
    lines = str(error.value).splitlines()
    assert len(lines) == 4
    assert "people: expected a list of people, got nothing" in lines[1]
    assert "people[0].pose_keypoints_2d: expected 75 numbers" in lines[2]
    assert "expected numbers only" in lines[3]


def test_folders_without_frames_are_refused(tmp_path):
    with pytest.raises(ValueError, match="expected a folder"):
        read_openpose(tmp_path / "none", "body25")
    with pytest.raises(ValueError, match=r"found no \.json file"):
        read_openpose(tmp_path, "body25")
    (tmp_path / "clip.json").write_text("{}")
    with pytest.raises(ValueError, match="expected a frame number"):
        read_openpose(tmp_path, "body25")


BODY = np.column_stack([np.arange(25) * 3.0, np.arange(25) * 5.0])
FRAMES = np.array([4, 5, 6])


def person(shift: float, left: list[float] | None, right: list[float] | None) -> dict:
    rows = np.column_stack([BODY + shift, np.ones(25)])
    made: dict = {"pose_keypoints_2d": rows.ravel().tolist()}
    if left is not None:
        made["hand_left_keypoints_2d"] = left
    if right is not None:
        made["hand_right_keypoints_2d"] = right
    return made


def hand(value: float) -> list[float]:
    return np.column_stack([np.full((21, 2), value), np.full(21, 0.5)]).ravel().tolist()


def write_hands(folder: Path, frame: int, people: list[dict]) -> None:
    (folder / f"v_{frame:012d}_keypoints.json").write_text(json.dumps({"people": people}))


def test_the_hands_of_this_very_person(tmp_path: Path) -> None:
    write_hands(tmp_path, 4, [person(90, hand(1), hand(2)), person(0, hand(3), None)])
    write_hands(tmp_path, 6, [person(0, [], hand(5)), person(90, hand(1), hand(2))])
    hands = read_openpose_hands(tmp_path, FRAMES, np.stack([BODY] * 3))
    xy, confidence = hands
    assert (xy[0, 0] == 3).all()
    assert (xy[2, 1] == 5).all()
    assert np.isnan(xy[0, 1]).all()
    assert np.isnan(xy[1]).all()
    assert (confidence > 0).sum() == 42


def test_without_hands_there_are_none(tmp_path: Path) -> None:
    write_hands(tmp_path, 4, [person(0, None, [])])
    assert read_openpose_hands(tmp_path, FRAMES, np.stack([BODY] * 3)) is None


def test_a_hand_of_another_length_is_named(tmp_path: Path) -> None:
    write_hands(tmp_path, 4, [person(0, hand(1)[:60], None)])
    with pytest.raises(ValueError, match=r"hand_left_keypoints_2d: expected 63 numbers.*got 60"):
        read_openpose_hands(tmp_path, FRAMES, np.stack([BODY] * 3))
