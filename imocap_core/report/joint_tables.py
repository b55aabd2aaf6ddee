"""Tables of the errors of each joint: positions and rotations."""

from __future__ import annotations

from collections.abc import Mapping

from imocap_core.artifacts.schemas import Table
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.evaluate.action_scores import ActionScores
from imocap_core.evaluate.whole_body import JointErrors


def joint_tables(scores: ActionScores) -> list[Table]:
    """One row a joint, one column a result; tables without values are omitted."""
    tables = [
        _joint_table(
            "joints",
            "Error of each joint after alignment on the twelve joints (joint_error_aligned_12_mm)",
            scores.joint_errors_mm,
            "mm",
        ),
        _joint_table(
            "joint_rotations",
            "Error of the rotation of each joint relative to its parent",
            scores.joint_errors_deg,
            "deg",
        ),
    ]
    return [table for table in tables if table.rows]


def _joint_table(name: str, title: str, errors: Mapping[str, JointErrors], unit: str) -> Table:
    joints = [joint for joint in SMPL_JOINTS if any(joint in of for of in errors.values())]
    return Table(
        name=name,
        title=title,
        columns=["joint", *(f"{result.replace(' ', '_')}_{unit}" for result in errors)],
        rows=[[joint, *(of.get(joint) for of in errors.values())] for joint in joints],
    )
