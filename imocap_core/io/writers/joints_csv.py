"""Joints as comma-separated values: one row per frame, three columns per joint."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float

from imocap_core.io.writers.motion_clip import MotionClip

FIRST = ("time_s", "frame", "phase_s", "inside")


def write_joints_csv(
    file: Path, clip: MotionClip, sd_mm: Mapping[str, Float[np.ndarray, " T"]]
) -> None:
    """Write one motion clip; sd_mm: standard deviations of those joints of which it is known.

    Columns: `time_s` from the first row, `frame` of the source video (fractional between two),
    `phase_s` on the common axis (empty where unknown), `inside` (0 where the video does not show
    the moment), then `<joint>_x_m`, `_y_m`, `_z_m`, then `<joint>_sd_m` (empty where unknown).
    """
    with_sd = [joint for joint in clip.joint_names if joint in sd_mm]
    columns = [f"{joint}_{axis}_m" for joint in clip.joint_names for axis in "xyz"]
    with file.open("w", newline="", encoding="utf-8") as stream:
        rows = csv.writer(stream, lineterminator="\n")
        rows.writerow([*FIRST, *columns, *(f"{joint}_sd_m" for joint in with_sd)])
        for t, joints in enumerate(clip.joints):
            rows.writerow(
                [
                    f"{clip.times_s[t]:.6f}",
                    f"{clip.frames[t]:.6f}".rstrip("0").rstrip("."),
                    _cell(clip.phase_s[t]),
                    int(clip.inside[t]),
                    *(f"{x:.6f}" for x in joints.ravel()),
                    *(_cell(sd_mm[joint][t] / 1000) for joint in with_sd),
                ]
            )


def _cell(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.6f}"
