"""Motions and cameras as text: joints, joint angles, events as CSV, markers as TRC, calibrations.

Calibrations of static cameras as other programs read them. `Calib.toml`: Pose2Sim's and
aniposelib's tables, a camera each (Pose2Sim's utilities convert it to and from the formats of other
programs). `intri.yml` and `extri.yml`: OpenCV's FileStorage with EasyMocap's names. Rotations are
rotation vectors and matrices camera from world, lengths metres, distortions OpenCV's k1, k2, p1, p2
and, where it is not 0, k3.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from imocap_core.biomechanics.events import MotionEvent
from imocap_core.files import write_csv
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
    rows = [
        [
            f"{clip.times_s[t]:.6f}",
            f"{clip.frames[t]:.6f}".rstrip("0").rstrip("."),
            _cell(clip.phase_s[t], 6),
            int(clip.inside[t]),
            *(f"{x:.6f}" for x in joints.ravel()),
            *(_cell(sd_mm[joint][t] / 1000, 6) for joint in with_sd),
        ]
        for t, joints in enumerate(clip.joints)
    ]
    write_csv(file, [*FIRST, *columns, *(f"{joint}_sd_m" for joint in with_sd)], rows)


def _cell(value: float, decimals: int) -> str:
    return "" if np.isnan(value) else f"{value:.{decimals}f}"


def write_angles_csv(file: Path, columns: Mapping[str, Float[np.ndarray, " T"]]) -> None:
    """Write columns of one length, a row each moment; what is NaN is left empty.

    Seconds and frames have four decimals, angles (names that end with `_deg`) two.
    """
    texts = [
        [
            _cell(v, 2) if name.endswith("_deg") else _cell(v, 4).rstrip("0").rstrip(".")
            for v in values
        ]
        for name, values in columns.items()
    ]
    write_csv(file, columns, zip(*texts, strict=True))


COLUMNS = (
    *("time_s", "earliest_s", "latest_s", "frame", "phase_s"),
    *("kind", "name", "value", "unit", "value_sd"),
)


def write_events_csv(
    file: Path,
    events: Sequence[MotionEvent],
    time_s: Float[np.ndarray, " T"],
    frames: Float[np.ndarray, " T"],
    phase_s: Float[np.ndarray, " T"],
) -> None:
    """Write events, a row each; what is NaN is left empty.

    time_s, frames, phase_s: of the frames whose positions the events' indices are.
    """
    position = np.arange(len(time_s))
    rows = []
    for event in events:
        moments = (event.index, event.earliest, event.latest)
        rows.append(
            [
                *(_cell(np.interp(i, position, time_s), 4) for i in moments),
                _cell(np.interp(event.index, position, frames), 2),
                _cell(np.interp(event.index, position, phase_s), 4),
                event.kind,
                event.name,
                _cell(event.value, 2),
                event.unit,
                _cell(event.sd, 2),
            ]
        )
    write_csv(file, COLUMNS, rows)


DECIMALS = 3  # 0.001 mm


def write_trc(file: Path, clip: MotionClip) -> None:
    """Write one motion clip; its first line contains the file name, as the format requires."""
    write_text(file, trc_text(clip, file.name))


def write_markers(
    file: Path, markers_mm: Mapping[str, Float[np.ndarray, "T 3"]], fps: float, start: int
) -> None:
    """Write markers over time (`markers_text`)."""
    write_text(file, markers_text(markers_mm, file.name, fps, start))


def write_text(file: Path, text: str) -> None:
    """Write text, lines ending alike on every system."""
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


@dataclass(frozen=True)
class CameraCalibration:
    """One camera.

    Attributes:
        id: the video; size: width and height, pixels.
        K: (3, 3) pixels; R: (3, 3) and t: (3,) metres, camera from world.
        distortion: OpenCV's k1, k2, p1, p2, k3, relative to K.
    """

    id: str
    size: tuple[int, int]
    K: Float[np.ndarray, "3 3"]
    R: Float[np.ndarray, "3 3"]
    t: Float[np.ndarray, " 3"]
    distortion: tuple[float, ...]

    @property
    def distortions(self) -> list[float]:
        """k1, k2, p1, p2 and, where it is not 0, k3, which not every program reads."""
        filled = [*self.distortion, *[0.0] * (5 - len(self.distortion))]
        return filled if filled[4] else filled[:4]


def write_calibration(out: Path, cameras: Sequence[CameraCalibration]) -> list[Path]:
    """The three files in the folder `out`."""
    texts = {
        "Calib.toml": calib_toml(cameras),
        "intri.yml": intri_yml(cameras),
        "extri.yml": extri_yml(cameras),
    }
    for name, text in texts.items():
        write_text(out / name, text)
    return [out / name for name in texts]


def calib_toml(cameras: Sequence[CameraCalibration]) -> str:
    """Pose2Sim's calibration file."""
    tables = []
    for camera in cameras:
        rotation = Rotation.from_matrix(camera.R).as_rotvec()
        fields = {
            "name": camera.id,
            "size": [float(side) for side in camera.size],
            "matrix": camera.K.tolist(),
            "distortions": camera.distortions,
            "rotation": rotation.tolist(),
            "translation": camera.t.tolist(),
            "fisheye": False,
        }
        rows = [f"{key} = {json.dumps(value)}" for key, value in fields.items()]
        tables.append("\n".join([f"[{json.dumps(camera.id)}]", *rows]))
    tables.append("[metadata]\nadjusted = false\nerror = 0.0")
    return "\n\n".join(tables) + "\n"


def intri_yml(cameras: Sequence[CameraCalibration]) -> str:
    """OpenCV's FileStorage of `K_<id>` and `dist_<id>`."""
    matrices = {}
    for camera in cameras:
        matrices[f"K_{camera.id}"] = camera.K
        matrices[f"dist_{camera.id}"] = np.array([[*camera.distortions, 0.0][:5]])
    return _file_storage([camera.id for camera in cameras], matrices)


def extri_yml(cameras: Sequence[CameraCalibration]) -> str:
    """OpenCV's FileStorage of `R_<id>` (rotation vector), `Rot_<id>` and `T_<id>`."""
    matrices = {}
    for camera in cameras:
        matrices[f"R_{camera.id}"] = Rotation.from_matrix(camera.R).as_rotvec()[:, None]
        matrices[f"Rot_{camera.id}"] = camera.R
        matrices[f"T_{camera.id}"] = camera.t[:, None]
    return _file_storage([camera.id for camera in cameras], matrices)


def _file_storage(names: Sequence[str], matrices: dict[str, Float[np.ndarray, "_ _"]]) -> str:
    lines = ["%YAML:1.0", "---", "names:", *(f'   - "{name}"' for name in names)]
    for key, matrix in matrices.items():
        rows, columns = matrix.shape
        data = ", ".join(f"{value:.17g}" if value else "0." for value in matrix.ravel())
        lines += [
            f"{key}: !!opencv-matrix",
            f"   rows: {rows}",
            f"   cols: {columns}",
            "   dt: d",
            f"   data: [ {data} ]",
        ]
    return "\n".join(lines) + "\n"
