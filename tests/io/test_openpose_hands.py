"""Hands go with the person whose body is given; wrong ones are named."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from imocap_core.io.readers.openpose import read_openpose_hands

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


def write(folder: Path, frame: int, people: list[dict]) -> None:
    (folder / f"v_{frame:012d}_keypoints.json").write_text(json.dumps({"people": people}))


def test_the_hands_of_this_very_person(tmp_path: Path) -> None:
    write(tmp_path, 4, [person(90, hand(1), hand(2)), person(0, hand(3), None)])
    write(tmp_path, 6, [person(0, [], hand(5)), person(90, hand(1), hand(2))])
    hands = read_openpose_hands(tmp_path, FRAMES, np.stack([BODY] * 3))
    assert hands is not None
    xy, confidence = hands
    assert (xy[0, 0] == 3).all()
    assert (xy[2, 1] == 5).all()
    assert np.isnan(xy[0, 1]).all()
    assert np.isnan(xy[1]).all()
    assert (confidence > 0).sum() == 42


def test_without_hands_there_are_none(tmp_path: Path) -> None:
    write(tmp_path, 4, [person(0, None, [])])
    assert read_openpose_hands(tmp_path, FRAMES, np.stack([BODY] * 3)) is None


def test_a_hand_of_another_length_is_named(tmp_path: Path) -> None:
    write(tmp_path, 4, [person(0, hand(1)[:60], None)])
    with pytest.raises(ValueError, match=r"hand_left_keypoints_2d: expected 63 numbers.*got 60"):
        read_openpose_hands(tmp_path, FRAMES, np.stack([BODY] * 3))
