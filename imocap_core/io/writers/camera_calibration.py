"""Calibrations of static cameras as other programs read them.

`Calib.toml`: Pose2Sim's and aniposelib's tables, a camera each (Pose2Sim's utilities convert it to
and from the formats of other programs). `intri.yml` and `extri.yml`: OpenCV's FileStorage with
EasyMocap's names. Rotations are rotation vectors and matrices camera from world, lengths metres,
distortions OpenCV's k1, k2, p1, p2 and, where it is not 0, k3.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation


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
    files = []
    for name, text in texts.items():
        files.append(out / name)
        files[-1].write_text(text, encoding="utf-8", newline="\n")
    return files


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
