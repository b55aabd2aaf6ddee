"""Track row column (TRC), which OpenSim and Pose2Sim read: joints as markers, millimetres."""

from __future__ import annotations

from pathlib import Path

from imocap_core.io.writers.motion_clip import Take

DECIMALS = 3  # thousandths of a millimetre


def write_trc(file: Path, take: Take) -> None:
    """Write one take; the file names itself in its first line, as the format wants it."""
    file.write_text(trc_text(take, file.name), encoding="utf-8", newline="\n")


def trc_text(take: Take, name: str) -> str:
    """The whole file. Frames count from 1; the first source frame is OrigDataStartFrame."""
    count, markers = take.joints.shape[:2]
    rate, start = f"{take.fps:.6g}", round(float(take.frames[0]))
    head = "DataRate CameraRate NumFrames NumMarkers Units OrigDataRate OrigDataStartFrame"
    values = [rate, rate, count, markers, "mm", rate, start, count]
    axes = [f"{axis}{k + 1}" for k in range(markers) for axis in "XYZ"]
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{name}",
        "\t".join([*head.split(), "OrigNumFrames"]),
        "\t".join(map(str, values)),
        "\t".join(["Frame#", "Time", *("\t\t".join([joint, ""]) for joint in take.joint_names)]),
        "\t".join(["", "", *axes]),
        "",
    ]
    for t, (time_s, joints) in enumerate(zip(take.times_s, take.joints, strict=True)):
        numbers = (f"{1000 * x:.{DECIMALS}f}" for x in joints.ravel())
        lines.append("\t".join([str(t + 1), f"{time_s:.6f}", *numbers]))
    return "\n".join(lines) + "\n"
