"""Human3.6M's files as VideoPose3D writes them, and pickles that would run code."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.actions.h36m_files import FILE_2D, FILE_3D, H36M_17, read_h36m
from imocap_core.io.array_files import read_object


def write_h36m(folder: Path, tree_3d: dict, tree_2d: dict) -> None:
    np.savez_compressed(folder / FILE_3D, positions_3d=np.array(tree_3d, dtype=object))
    metadata = {"layout_name": "h36m", "num_joints": 17, "keypoints_symmetry": [[4], [1]]}
    np.savez_compressed(
        folder / FILE_2D,
        positions_2d=np.array(tree_2d, dtype=object),
        metadata=np.array(metadata, dtype=object),
    )


def test_joints_are_the_seventeen_that_move_and_lengths_the_shorter(tmp_path: Path) -> None:
    joints = np.arange(5 * 32 * 3, dtype=np.float32).reshape(5, 32, 3)
    views = [np.full((6, 17, 2), c, np.float32) for c in range(4)]
    write_h36m(
        tmp_path,
        {"S9": {"Photo": joints, "Waiting": joints}, "S1": {"Photo": joints}},
        {"S9": {"Photo": views}},
    )
    recordings = read_h36m(tmp_path)
    assert {s: list(actions) for s, actions in recordings.items()} == {"S9": ["Photo"]}
    recording = recordings["S9"]["Photo"]
    assert recording.joints_m.shape == (5, 17, 3)
    assert recording.xy_px.shape == (4, 5, 17, 2)
    assert recording.xy_px[:, 0, 0, 0].tolist() == [0, 1, 2, 3]
    # The 32 joints' numbers: left ankle 8, head top 15, left wrist 19, right wrist 27.
    for name, of_32 in (("left_ankle", 8), ("head", 15), ("left_wrist", 19), ("right_wrist", 27)):
        assert (recording.joints_m[:, H36M_17.index(name)] == joints[:, of_32]).all()


def test_seventeen_joints_are_taken_as_they_are(tmp_path: Path) -> None:
    joints = np.random.default_rng(0).normal(size=(4, 17, 3))
    write_h36m(tmp_path, {"S9": {"Photo": joints}}, {"S9": {"Photo": [np.ones((4, 17, 2))] * 4}})
    assert (read_h36m(tmp_path)["S9"]["Photo"].joints_m == joints).all()


@pytest.mark.parametrize(
    ("joints", "views", "message"),
    [
        (np.ones((4, 16, 3)), [np.ones((4, 17, 2))] * 4, r"S9, Photo: expected numbers \(T, 32, 3"),
        (np.ones((4, 17, 3)), [np.ones((4, 17, 2))] * 3, "expected 4 cameras, got 3"),
        (np.ones((4, 17, 3)), [np.ones((4, 17, 3))] * 4, r"expected numbers \(T, 17, 2\)"),
        (np.ones((4, 17, 3)), "no", "expected 4 cameras, got str"),
    ],
)
def test_wrong_shapes_are_named(tmp_path: Path, joints: Any, views: Any, message: str) -> None:
    write_h36m(tmp_path, {"S9": {"Photo": joints}}, {"S9": {"Photo": views}})
    with pytest.raises(ValueError, match=message):
        read_h36m(tmp_path)


def test_files_that_share_nothing_are_named(tmp_path: Path) -> None:
    write_h36m(tmp_path, {"S9": {}}, {"S11": {}})
    with pytest.raises(ValueError, match="share no subject and action"):
        read_h36m(tmp_path)


class Opens:
    """Pickles as a call that makes a file."""

    def __init__(self, file: Path) -> None:
        self.file = file

    def __reduce__(self) -> tuple[Any, tuple[str, str]]:
        return open, (str(self.file), "w")


def test_a_pickle_that_would_run_code_is_refused_and_runs_nothing(tmp_path: Path) -> None:
    made = tmp_path / "made"
    evil = np.array({"S9": {"Photo": Opens(made)}}, dtype=object)
    np.savez(tmp_path / "x.npz", positions_3d=evil)
    with pytest.raises(ValueError, match=r"refused, it can't be read safely: it names \w+\.open"):
        read_object(tmp_path / "x.npz", "positions_3d")
    assert not made.exists()


def test_what_is_no_object_array_is_named(tmp_path: Path) -> None:
    file = tmp_path / "x.npz"
    with pytest.raises(ValueError, match="no such file"):
        read_object(file, "a")
    file.write_bytes(b"PK no zip")
    with pytest.raises(ValueError, match="is not a readable npz file"):
        read_object(file, "a")
    np.savez(file, b=np.ones(3))
    with pytest.raises(ValueError, match="expected an array of that name, the file has b"):
        read_object(file, "a")
    with pytest.raises(ValueError, match="expected one Python object"):
        read_object(file, "b")
    np.savez(file, a=np.array({"k": np.ones(1000)}, dtype=object))
    whole = file.read_bytes()
    file.write_bytes(whole[:200] + b"\0" * 60 + whole[260:])
    with pytest.raises(ValueError, match=r"readable npz file|read safely"):
        read_object(file, "a")
