"""Joints as comma-separated values: one row per frame, three columns per joint."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from imocap_core.io.writers.motion_clip import MotionClip

FIRST = ("time_s", "frame", "phase_s", "inside")


def write_joints_csv(file: Path, clip: MotionClip) -> None:
    """Write one motion clip.

    Columns: `time_s` from the first row, `frame` of the source video (fractional between two),
    `phase_s` on the common axis (empty where unknown), `inside` (0 where the video does not show
    the moment), then `<joint>_x_m`, `_y_m`, `_z_m`.
    """
    columns = [f"{joint}_{axis}_m" for joint in clip.joint_names for axis in "xyz"]
    with file.open("w", newline="", encoding="utf-8") as stream:
        rows = csv.writer(stream, lineterminator="\n")
        rows.writerow([*FIRST, *columns])
        for t, joints in enumerate(clip.joints):
            phase = clip.phase_s[t]
            rows.writerow(
                [
                    f"{clip.times_s[t]:.6f}",
                    f"{clip.frames[t]:.6f}".rstrip("0").rstrip("."),
                    "" if np.isnan(phase) else f"{phase:.6f}",
                    int(clip.inside[t]),
                    *(f"{x:.6f}" for x in joints.ravel()),
                ]
            )
