"""Rows of the whole-body metrics: named, complete, and unscored with a reason."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.conventions import EVAL_12, SMPL_JOINTS
from imocap_core.metrics.scoring import (
    CameraJoints,
    ScoreRow,
    aligned_errors_mm,
    jitter_row,
    joint_group_rows,
    rotation_rows,
    segment_rows,
    stretch_rows,
    world_rows,
)


@pytest.fixture
def joints() -> np.ndarray:
    return np.random.default_rng(5).normal(scale=0.3, size=(8, 24, 3)) + np.array([0, 0, 4])


def _motion(joints: np.ndarray, names: tuple[str, ...] = SMPL_JOINTS) -> CameraJoints:
    return CameraJoints(joints, names, np.arange(len(joints)))


def _values(rows: list[ScoreRow]) -> dict[str, float | None]:
    return {row.metric: row.value for row in rows}


def test_joints_besides_the_twelve_have_their_own_errors(joints: np.ndarray) -> None:
    off = joints.copy()
    off[:, SMPL_JOINTS.index("spine2")] += [0.09, 0, 0]
    off[:, SMPL_JOINTS.index("neck")] += [0, 0.03, 0]
    rows = _values(joint_group_rows("final", "v1", _motion(off), _motion(joints)))
    assert rows == {"spine_mm": pytest.approx(30.0), "collars_neck_mm": pytest.approx(10.0)}
    errors = aligned_errors_mm(_motion(off), _motion(joints))
    assert list(errors) == list(SMPL_JOINTS)
    assert errors["spine2"] == pytest.approx(90.0)
    assert max(errors[name] for name in EVAL_12) == pytest.approx(0, abs=1e-9)


def test_a_truth_of_twelve_joints_scores_the_world_but_not_the_spine(joints: np.ndarray) -> None:
    twelve = _motion(joints[:, [SMPL_JOINTS.index(name) for name in EVAL_12]], EVAL_12)
    groups = joint_group_rows("final", "v1", _motion(joints), twelve)
    assert [row.value for row in groups] == [None, None]
    assert "spine1" in groups[0].note
    world = _values(world_rows("final", "v1", _motion(joints), twelve))
    assert world["w_mpjpe_mm"] == pytest.approx(0, abs=1e-9)
    assert world["rte_pct"] == pytest.approx(0, abs=1e-9)


def test_frames_with_missing_joints_are_left_out_of_the_world(joints: np.ndarray) -> None:
    holed = joints.copy()
    holed[3, 5] = np.nan
    world = _values(world_rows("final", "v1", _motion(joints + 1), _motion(holed)))
    assert world["wa_mpjpe_mm"] == pytest.approx(0, abs=1e-9)


def test_rotation_rows_have_the_spine_by_itself() -> None:
    true = np.tile(np.eye(3), (4, 24, 1, 1))
    half_turn = np.diag([1.0, -1.0, -1.0])
    predicted = true.copy()
    predicted[:, SMPL_JOINTS.index("spine3")] = half_turn
    rows = _values(rotation_rows("final", "v1", predicted, true))
    assert rows == {
        "mpjae_deg": pytest.approx(180 / 24),
        "spine_rotation_error_deg": pytest.approx(60.0),
    }


def test_segment_rows_are_angles_and_name_what_is_missing() -> None:
    upright, half_turn = (
        np.tile(np.eye(3), (4, 1, 1)),
        np.tile(np.diag([-1.0, 1.0, -1.0]), (4, 1, 1)),
    )
    predicted = {"pelvis": upright, "spine3": half_turn, "head": upright}
    rows = segment_rows("final", "v1", predicted, {"pelvis": upright, "spine3": upright})
    values = {row.metric: row.value for row in rows}
    assert values["pelvis_rotation_error_deg"] == pytest.approx(0.0)
    assert values["chest_rotation_error_deg"] == pytest.approx(180.0)
    assert values["head_rotation_error_deg"] is None
    assert "head" in {row.metric: row.note for row in rows}["head_rotation_error_deg"]


def test_directions_of_neck_and_collars_ignore_turns_about_the_bone() -> None:
    upright = np.tile(np.eye(3), (4, 1, 1))
    about_x = np.tile(Rotation.from_euler("x", 40, degrees=True).as_matrix(), (4, 1, 1))
    predicted = {"neck": about_x, "left_collar": about_x, "right_collar": about_x}
    true = dict.fromkeys(predicted, upright)
    values = _values(segment_rows("final", "v1", predicted, true))
    assert values["neck_direction_error_deg"] == pytest.approx(40.0)
    assert values["collars_direction_error_deg"] == pytest.approx(0.0, abs=1e-9)
    del true["right_collar"]
    rows = segment_rows("final", "v1", predicted, true)
    assert _values(rows)["collars_direction_error_deg"] is None
    assert "right_collar" in rows[-1].note


def test_stretch_rows_are_per_cent_mean_and_worst() -> None:
    rows = stretch_rows("final", "v1", np.array([0.01, 0.03]), np.array([0.9, 1.2]))
    assert [row.value for row in rows] == pytest.approx([2.0, 3.0, 15.0, 20.0])


def test_jitter_of_too_short_a_motion_is_not_scored(joints: np.ndarray) -> None:
    assert jitter_row("final", "v1", _motion(joints), 30.0).value is not None
    short = jitter_row("final", "v1", _motion(joints[:3]), 30.0)
    assert (short.value, short.note) == (None, "no four frames in a row")
