"""Blender's joints of exported BVH and GLB files against ours, in millimetres.

python tools/check_in_blender.py ACTION --blender PYTHON [--root DIR]

PYTHON is an interpreter that has `bpy` (Blender as a module, an environment of its own). Every
video is looked at in five frames, on both timelines; the largest distance of any joint is printed.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from imocap_core.export.clips import camera_of, shaped_of, take_of
from imocap_core.export.common_time import on_common_time
from imocap_core.export.formats import export
from imocap_core.export.sources import read_result
from imocap_core.export.values import Result
from imocap_core.io.writers.motion_clip import MotionClip
from imocap_core.workspace import Workspace

READER = Path(__file__).with_name("blender_joints.py")


def main() -> None:
    """Export, let Blender read, compare."""
    arguments = argparse.ArgumentParser()
    arguments.add_argument("action")
    arguments.add_argument("--blender", type=Path, required=True)
    arguments.add_argument("--root", type=Path, default=Path())
    given = arguments.parse_args()
    job = Workspace(given.root).job(given.action, [])
    for time in ("own", "common"):
        for format, up in (("bvh", "y"), ("bvh", "z"), ("glb", "y")):
            with tempfile.TemporaryDirectory() as folder:
                done = export(job.store, job.action.name, format, Path(folder), up, time)
                result = read_result(job.store, job.action.name, up)
                if time == "common":
                    result = on_common_time(result)
                files = [f for f in done.files if f.suffix == f".{format}"]
                for said in compare(given.blender, files, result, up):
                    print(f"{format} up {up}, {time:<6} {said}")


def compare(python: Path, files: list[Path], result: Result, up: str) -> list[str]:
    """A sentence a video."""
    said = []
    for p in result.performances:
        take = take_of(p, shaped_of(result, p))
        frames = np.linspace(0, len(take.frames) - 1, 5).astype(int)
        file = next((f for f in files if f.stem == p.id), files[0])
        seen = read_in_blender(python, file, round(take.fps), frames.tolist(), up)
        said.append(f"{p.id}: joints within {1000 * joint_error_m(take, frames, seen, up):.4f} mm")
        camera = seen["cameras"].get(f"{p.id}_camera")
        if camera is not None:
            ours = camera_of(p)
            width, height = ours.size
            side = width if camera["across"] == "HORIZONTAL" else height
            focal = 0.5 * side / np.tan(camera["angle"] / 2)
            place = np.linalg.norm(blender_axes(ours.centre, "y") - camera["location"])
            said[-1] += (
                f"; camera within {1000 * place:.4f} mm, its focal length within "
                f"{abs(focal - ours.K[1, 1]):.4f} px"
            )
    return said


def read_in_blender(python: Path, file: Path, fps: int, frames: list[int], up: str) -> dict:
    """What tools/blender_joints.py finds."""
    out = file.with_suffix(".json")
    command = [python, READER, file, out, "--fps", str(fps), "--up", up, "--frames"]
    told = [*map(str, command), *map(str, frames)]
    run = subprocess.run(told, capture_output=True, text=True, check=False)
    if run.returncode != 0:
        raise SystemExit(f"{python} could not read {file}:\n{run.stderr}")
    return json.loads(out.read_text())


def joint_error_m(take: MotionClip, frames: np.ndarray, seen: dict, up: str) -> float:
    """The largest distance of any joint in any of the frames."""
    theirs = np.array([seen[take.id][name] for name in take.joint_names]).swapaxes(0, 1)
    ours = blender_axes(take.joints[frames], up)
    return float(np.linalg.norm(theirs - ours, axis=-1).max())


def blender_axes(points: np.ndarray, up: str) -> np.ndarray:
    """Our world to Blender's, whose z is up: with y up its importers turn (x, y, z) to
    (x, -z, y)."""
    if up == "z":
        return points
    return np.stack([points[..., 0], -points[..., 2], points[..., 1]], axis=-1)


if __name__ == "__main__":
    main()
