"""The files of a calibrated rig's truth beside action.yaml (`pose2sim_truth` reads them)."""

from __future__ import annotations

from pathlib import Path

CALIBRATION = "calibration.npz"
REFERENCE = "trc_reference.npz"
FILES = (CALIBRATION, REFERENCE)


def has_pose2sim_truth(folder: Path) -> bool:
    """Whether an action's folder has both files."""
    return all((folder / name).is_file() for name in FILES)
