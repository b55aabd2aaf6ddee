"""Joints as comma-separated values: one row a frame, three columns a joint, units in the names."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from imocap_core.io.writers.motion_clip import Take

FIRST = ("time_s", "frame", "phase_s", "inside")


def write_joints_csv(file: Path, take: Take) -> None:
    """Write one take: `time_s` from its first row, `frame` of the source video (fractional between
    two), `phase_s` on the common axis (empty where unknown), `inside` 0 where the video shows
    nothing of the moment, then `<joint>_x_m`, `_y_m`, `_z_m`."""
    columns = [f"{joint}_{axis}_m" for joint in take.joint_names for axis in "xyz"]
    with file.open("w", newline="", encoding="utf-8") as stream:
        rows = csv.writer(stream, lineterminator="\n")
        rows.writerow([*FIRST, *columns])
        for t, joints in enumerate(take.joints):
            phase = take.phase_s[t]
            rows.writerow(
                [
                    f"{take.times_s[t]:.6f}",
                    f"{take.frames[t]:.6f}".rstrip("0").rstrip("."),
                    "" if np.isnan(phase) else f"{phase:.6f}",
                    int(take.inside[t]),
                    *(f"{x:.6f}" for x in joints.ravel()),
                ]
            )
