"""Joints of exported FBX and USD characters in Blender and in other readers, against ours.

python -m tools.check_characters ACTION --blender PYTHON [--readers PYTHON] [--root DIR]

The first PYTHON has `bpy`, the second `ufbx`, `usd-core` and numpy (environments of their own). The
mean performance with Mixamo's names and a root bone is exported; the largest distance of any joint
in five frames is printed, and what the files say of unit, axis and frame rate.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from imocap_core.export.clips import as_character, clip_of
from imocap_core.export.export_options import ExportOptions
from imocap_core.export.formats import export
from imocap_core.io.writers.motion_clip import MotionClip
from imocap_core.library.outputs import result_of
from imocap_core.result.derived import mean_performance
from imocap_core.result.video_motion import shaped_body
from tools.check_in_blender import blender_axes, read_in_blender

READER = Path(__file__).with_name("fbx_usd_joints.py")
CHARACTER = ExportOptions(mean=True, names="mixamo", root_bone=True)


def main() -> None:
    """Export, let others read, compare."""
    arguments = argparse.ArgumentParser()
    arguments.add_argument("action")
    arguments.add_argument("--blender", type=Path, required=True)
    arguments.add_argument("--readers", type=Path)
    arguments.add_argument("--root", type=Path, default=Path())
    given = arguments.parse_args()
    os.environ["IMOCAP_BLENDER"] = str(given.blender)
    action = result_of(given.action, given.root)
    for format, up in (("fbx", "y"), ("usd", "y"), ("usd", "z")):
        with tempfile.TemporaryDirectory() as folder:
            file = export(action, format, Path(folder), up, options=CHARACTER).files[0]
            mean = mean_performance(action.levelled(up).on_common_time()).videos[0]
            clip = as_character(clip_of(mean, shaped_body(mean)), CHARACTER, up)
            frames = np.linspace(0, len(clip.frames) - 1, 5).astype(int)
            skin = mean.vertices(frames)
            print(f"{format} up {up} {in_blender(given.blender, file, clip, skin, frames, up)}")
            if given.readers:
                print(f"{format} up {up} {elsewhere(given.readers, file, clip, frames)}")


def in_blender(
    python: Path, file: Path, clip: MotionClip, skin: np.ndarray, frames: np.ndarray, up: str
) -> str:
    """A sentence about what Blender reads."""
    read = read_in_blender(python, file, round(clip.fps), frames.tolist(), up, skin=True)
    skin_mm = 1000 * np.linalg.norm(read.pop("skin") - blender_axes(skin, up), axis=-1).max()
    fps = read.pop("fps")
    read.pop("cameras")
    ours = blender_axes(clip.joints[frames], up)
    (joints,) = read.values()
    error_mm = 1000 * joint_error_m(ours, clip, joints)
    return (
        f"Blender: joints within {error_mm:.4f} mm, skin within {skin_mm:.4f} mm, {fps:g} frames/s"
    )


def elsewhere(python: Path, file: Path, clip: MotionClip, frames: np.ndarray) -> str:
    """A sentence about what ufbx or OpenUSD reads."""
    read = read_elsewhere(python, file, frames)
    scaled = {name: read["metres"] * np.array(path) for name, path in read["joints"].items()}
    error_mm = 1000 * joint_error_m(clip.joints[frames], clip, scaled)
    return (
        f"second reader: joints within {error_mm:.4f} mm, {read['fps']:g} frames/s, {read['up']} "
        f"up, a unit is {read['metres']:g} m, {read['seconds']:.3f} s, materials "
        f"{read['materials']}, {read['skinned']} joints of the skin"
    )


def read_elsewhere(python: Path, file: Path, frames: np.ndarray) -> dict[str, Any]:
    """The output of tools/fbx_usd_joints.py."""
    out = file.with_suffix(".json")
    words = [python, READER, file, out, "--frames", *frames.tolist()]
    run = subprocess.run([str(w) for w in words], capture_output=True, text=True, check=False)
    if run.returncode != 0:
        raise SystemExit(f"{python} could not read {file}:\n{run.stderr}")
    return json.loads(out.read_text())


def joint_error_m(ours: np.ndarray, clip: MotionClip, read: dict[str, Any]) -> float:
    """The largest distance of any joint; USD has no colons in names."""
    names = [n if n in read else n.replace(":", "_").replace(".", "_") for n in clip.joint_names]
    theirs = np.array([read[name] for name in names]).swapaxes(0, 1)
    return float(np.linalg.norm(theirs - ours, axis=-1).max())


if __name__ == "__main__":
    main()
