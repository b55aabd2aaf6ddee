"""Track row column (TRC), which OpenSim and Pose2Sim read: joints as markers, millimetres."""

from __future__ import annotations

from pathlib import Path

from imocap_core.io.writers.motion_clip import MotionClip

DECIMALS = 3  # 0.001 mm


def write_trc(file: Path, clip: MotionClip) -> None:
    """Write one motion clip; its first line contains the file name, as the format requires."""
    file.write_text(trc_text(clip, file.name), encoding="utf-8", newline="\n")


def trc_text(clip: MotionClip, name: str) -> str:
    """The content of the file.

    Frames count from 1; OrigDataStartFrame is the first source frame.
    """
    count, markers = clip.joints.shape[:2]
    rate, start = f"{clip.fps:.6g}", round(float(clip.frames[0]))
    head = "DataRate CameraRate NumFrames NumMarkers Units OrigDataRate OrigDataStartFrame"
    values = [rate, rate, count, markers, "mm", rate, start, count]
    axes = [f"{axis}{k + 1}" for k in range(markers) for axis in "XYZ"]
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{name}",
        "\t".join([*head.split(), "OrigNumFrames"]),
        "\t".join(map(str, values)),
        "\t".join(["Frame#", "Time", *("\t\t".join([joint, ""]) for joint in clip.joint_names)]),
        "\t".join(["", "", *axes]),
        "",
    ]
    for t, (time_s, joints) in enumerate(zip(clip.times_s, clip.joints, strict=True)):
        numbers = (f"{1000 * x:.{DECIMALS}f}" for x in joints.ravel())
        lines.append("\t".join([str(t + 1), f"{time_s:.6f}", *numbers]))
    return "\n".join(lines) + "\n"
