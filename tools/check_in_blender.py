"""Blender's joints of exported BVH and GLB files against ours, in millimetres.

python tools/check_in_blender.py ACTION --blender PYTHON [--root DIR]

PYTHON is an interpreter that has `bpy` (Blender as a module, an environment of its own). Every
video is checked in five frames, on both timelines; the largest distance of any joint is printed.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from imocap_core.export.clips import camera_of, clip_of
from imocap_core.export.formats import export
from imocap_core.io.writers.motion_clip import MotionClip
from imocap_core.library.outputs import result_of
from imocap_core.result.result import ActionResult
from imocap_core.result.video_motion import shaped_body

READER = Path(__file__).with_name("blender_joints.py")


def main() -> None:
    """Export, let Blender read, compare."""
    arguments = argparse.ArgumentParser()
    arguments.add_argument("action")
    arguments.add_argument("--blender", type=Path, required=True)
    arguments.add_argument("--root", type=Path, default=Path())
    given = arguments.parse_args()
    action = result_of(given.action, given.root)
    for time in ("own", "common"):
        for format, up in (("bvh", "y"), ("bvh", "z"), ("glb", "y")):
            with tempfile.TemporaryDirectory() as folder:
                done = export(action, format, Path(folder), up, time)
                result = action.levelled(up)
                if time == "common":
                    result = result.on_common_time()
                files = [f for f in done.files if f.suffix == f".{format}"]
                for sentence in compare(given.blender, files, result, up):
                    print(f"{format} up {up}, {time:<6} {sentence}")


def compare(python: Path, files: list[Path], result: ActionResult, up: str) -> list[str]:
    """A sentence per video."""
    sentences = []
    for video in result:
        clip = clip_of(video, shaped_body(video))
        frames = np.linspace(0, len(clip.frames) - 1, 5).astype(int)
        file = next((f for f in files if f.stem == video.id), files[0])
        read = read_in_blender(python, file, round(clip.fps), frames.tolist(), up)
        error_mm = 1000 * joint_error_m(clip, frames, read, up)
        sentence = f"{video.id}: joints within {error_mm:.4f} mm"
        camera = read["cameras"].get(f"{video.id}_camera")
        if camera is not None:
            ours = camera_of(video)
            width, height = ours.size
            side = width if camera["across"] == "HORIZONTAL" else height
            focal = 0.5 * side / np.tan(camera["angle"] / 2)
            place = np.linalg.norm(blender_axes(ours.centre, "y") - camera["location"])
            sentence += (
                f"; camera within {1000 * place:.4f} mm, its focal length within "
                f"{abs(focal - ours.K[1, 1]):.4f} px"
            )
        sentences.append(sentence)
    return sentences


def read_in_blender(
    python: Path, file: Path, fps: int, frames: list[int], up: str, skin: bool = False
) -> dict:
    """The output of tools/blender_joints.py."""
    out = file.with_suffix(".json")
    command = [python, READER, file, out, "--fps", str(fps), "--up", up, "--frames"]
    arguments = [*map(str, command), *map(str, frames), *(["--skin"] if skin else [])]
    run = subprocess.run(arguments, capture_output=True, text=True, check=False)
    if run.returncode != 0:
        raise SystemExit(f"{python} could not read {file}:\n{run.stderr}")
    return json.loads(out.read_text())


def joint_error_m(clip: MotionClip, frames: np.ndarray, read: dict, up: str) -> float:
    """The largest distance of any joint in any of the frames."""
    theirs = np.array([read[clip.id][name] for name in clip.joint_names]).swapaxes(0, 1)
    ours = blender_axes(clip.joints[frames], up)
    return float(np.linalg.norm(theirs - ours, axis=-1).max())


def blender_axes(points: np.ndarray, up: str) -> np.ndarray:
    """Our world to Blender's, whose z is up: with y up its importers turn (x, y, z) to
    (x, -z, y)."""
    if up == "z":
        return points
    return np.stack([points[..., 0], -points[..., 2], points[..., 1]], axis=-1)


if __name__ == "__main__":
    main()
