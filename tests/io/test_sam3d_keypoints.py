"""SAM 3D Body's 70 points in the picture, as keypoints of body, feet and hands."""

from __future__ import annotations

import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imocap_core.body.layouts import hand_columns, layout_names
from imocap_core.io.readers.joint_estimators import NAMES
from imocap_core.io.readers.keypoint_readers import format_and_layout
from tests.io.detector_cases import read, refused

KIND, LAYOUT = "sam3d_body", "wholebody133"
POINTS = np.random.default_rng(0).integers(10, 350, size=(3, 2, 70, 2)).astype(float)
FORMS = {
    "lists of people": lambda t, people: people,
    "with frames": lambda t, people: {"frame": t + 5, "people": people},
    "one person": lambda t, people: people[0],
}


def write(folder: Path, form: str, name: str = "sam3d.json", **changes: Any) -> Path:
    content = [
        FORMS[form](t, [{"pred_keypoints_2d": p.tolist()} | changes for p in POINTS[t]])
        for t in range(len(POINTS))
    ]
    path = folder / name
    packed = pickle.dumps(content) if name.endswith("pkl") else json.dumps(content).encode()
    path.write_bytes(packed)
    return path


@pytest.mark.parametrize("form", FORMS)
def test_body_feet_and_hands_are_read(form: str, tmp_path: Path) -> None:
    path = write(tmp_path, form)
    assert format_and_layout(path, None, None) == (KIND, LAYOUT)
    detected = read(path, KIND, LAYOUT)
    assert detected.frames.tolist() == ([5, 6, 7] if form == "with frames" else [0, 1, 2])
    names = layout_names(LAYOUT)
    roots = {f"{side}_hand_root": f"{side}_wrist" for side in ("left", "right")}
    for t, people in enumerate(detected.people):
        assert len(people) == (1 if form == "one person" else 2)
        for person, points in zip(people, POINTS[t], strict=False):
            known = np.flatnonzero(person[:, 2])
            assert set(known) == {*range(23), *range(91, 133)}  # all but the face
            for column in known:
                place = NAMES.index(roots.get(names[column], names[column]))
                np.testing.assert_array_equal(person[column], [*points[place], 1.0])
    assert set(np.ravel(hand_columns(LAYOUT))) <= set(known)


def test_a_pickle_is_read_where_the_format_is_named(tmp_path: Path) -> None:
    path = write(tmp_path, "lists of people", "sam3d.pkl")
    assert format_and_layout(path, KIND, None) == (KIND, LAYOUT)
    assert len(read(path, KIND, LAYOUT).people) == 3


@pytest.mark.parametrize("points", [[[0.0, 0.0]] * 69, "text", None])
def test_other_points_are_refused(points: Any, tmp_path: Path) -> None:
    path = write(tmp_path, "lists of people", pred_keypoints_2d=points)
    assert "pred_keypoints_2d: expected numbers (70, 2)" in refused(path, KIND, LAYOUT)


@pytest.mark.parametrize("content", ["7", '"text"', "[1, 2]", "{}", "[[]]", "[]", "[{}]"])
def test_a_file_of_something_else_is_refused(content: str, tmp_path: Path) -> None:
    path = tmp_path / "sam3d.json"
    path.write_text(content)
    refused(path, KIND, LAYOUT)
    refused(path, KIND, "coco17")
