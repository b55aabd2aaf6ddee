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

import cv2
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
    """Write a clip's joints as markers; the first source frame is the nearest whole one."""
    joints = {joint: 1000 * clip.joints[:, j] for j, joint in enumerate(clip.joint_names)}
    write_markers(file, joints, clip.fps, round(float(clip.frames[0])))


def write_markers(
    file: Path, markers_mm: Mapping[str, Float[np.ndarray, "T 3"]], fps: float, start: int
) -> None:
    """Write markers over time, by their names; the file's first line contains its name, as the
    format requires.

    Frames count from 1; OrigDataStartFrame is the first source frame, `start`.
    """
    points = np.stack(list(markers_mm.values()), axis=1)
    count, markers = points.shape[:2]
    rate = f"{fps:.6g}"
    head = "DataRate CameraRate NumFrames NumMarkers Units OrigDataRate OrigDataStartFrame"
    values = [rate, rate, count, markers, "mm", rate, start, count]
    axes = [f"{axis}{k + 1}" for k in range(markers) for axis in "XYZ"]
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{file.name}",
        "\t".join([*head.split(), "OrigNumFrames"]),
        "\t".join(map(str, values)),
        "\t".join(["Frame#", "Time", *("\t\t".join([marker, ""]) for marker in markers_mm)]),
        "\t".join(["", "", *axes]),
        "",
    ]
    for t, row in enumerate(points):
        numbers = (f"{x:.{DECIMALS}f}" for x in row.ravel())
        lines.append("\t".join([str(t + 1), f"{t / fps:.6f}", *numbers]))
    file.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


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
    """Pose2Sim's Calib.toml; EasyMocap's files by OpenCV's FileStorage: intri.yml with `K_<id>`
    and `dist_<id>`, extri.yml with `R_<id>` (rotation vector), `Rot_<id>` and `T_<id>`."""
    toml, intri, extri = (out / name for name in ("Calib.toml", "intri.yml", "extri.yml"))
    toml.write_text(_calib_toml(cameras), encoding="utf-8", newline="\n")
    optics, places = {}, {}
    for camera in cameras:
        optics[f"K_{camera.id}"] = camera.K
        optics[f"dist_{camera.id}"] = np.array([[*camera.distortions, 0.0][:5]])
        places[f"R_{camera.id}"] = Rotation.from_matrix(camera.R).as_rotvec()[:, None]
        places[f"Rot_{camera.id}"] = camera.R
        places[f"T_{camera.id}"] = camera.t[:, None]
    for file, matrices in ((intri, optics), (extri, places)):
        storage = cv2.FileStorage(str(file), cv2.FILE_STORAGE_WRITE)
        storage.startWriteStruct("names", cv2.FileNode_SEQ)
        for camera in cameras:
            storage.write("", camera.id)
        storage.endWriteStruct()
        for name, matrix in matrices.items():
            storage.write(name, matrix)
        storage.release()
    return [toml, intri, extri]


def _calib_toml(cameras: Sequence[CameraCalibration]) -> str:
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
