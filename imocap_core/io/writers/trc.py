"""Track row column (TRC), which OpenSim and Pose2Sim read: joints as markers, millimetres."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float

from imocap_core.io.writers.motion_clip import MotionClip

DECIMALS = 3  # 0.001 mm


def write_trc(file: Path, clip: MotionClip) -> None:
    """Write one motion clip; its first line contains the file name, as the format requires."""
    _write(file, trc_text(clip, file.name))


def write_markers(
    file: Path, markers_mm: Mapping[str, Float[np.ndarray, "T 3"]], fps: float, start: int
) -> None:
    """Write markers over time (`markers_text`)."""
    _write(file, markers_text(markers_mm, file.name, fps, start))


def _write(file: Path, text: str) -> None:
    file.write_text(text, encoding="utf-8", newline="\n")


def trc_text(clip: MotionClip, name: str) -> str:
    """The content of the file of a clip's joints."""
    joints = {joint: 1000 * clip.joints[:, j] for j, joint in enumerate(clip.joint_names)}
    return markers_text(joints, name, clip.fps, round(float(clip.frames[0])))


def markers_text(
    markers_mm: Mapping[str, Float[np.ndarray, "T 3"]], name: str, fps: float, start: int
) -> str:
    """The content of a file of markers over time, by their names.

    Frames count from 1; OrigDataStartFrame is the first source frame, `start`.
    """
    points = np.stack(list(markers_mm.values()), axis=1)
    count, markers = points.shape[:2]
    rate = f"{fps:.6g}"
    head = "DataRate CameraRate NumFrames NumMarkers Units OrigDataRate OrigDataStartFrame"
    values = [rate, rate, count, markers, "mm", rate, start, count]
    axes = [f"{axis}{k + 1}" for k in range(markers) for axis in "XYZ"]
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{name}",
        "\t".join([*head.split(), "OrigNumFrames"]),
        "\t".join(map(str, values)),
        "\t".join(["Frame#", "Time", *("\t\t".join([marker, ""]) for marker in markers_mm)]),
        "\t".join(["", "", *axes]),
        "",
    ]
    for t, row in enumerate(points):
        numbers = (f"{x:.{DECIMALS}f}" for x in row.ravel())
        lines.append("\t".join([str(t + 1), f"{t / fps:.6f}", *numbers]))
    return "\n".join(lines) + "\n"
