"""The example that puts a motion onto a free rig. Needs IMOCAP_BLENDER, a Python with `bpy`."""

import os
import re
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest

from imocap_core.export.blender import write_characters
from imocap_core.io.writers.gltf import Actor, ClipCamera, skin_of, write_glb
from imocap_core.io.writers.rigs import as_rig
from tests.io.made_clips import made_clip

BLENDER = os.environ.get("IMOCAP_BLENDER")
pytestmark = pytest.mark.skipif(
    BLENDER is None, reason="IMOCAP_BLENDER names no interpreter with bpy"
)
EXAMPLE = Path(__file__).parents[2] / "examples" / "retarget_blender.py"


def actor(names: str) -> Actor:
    made = made_clip(frames=8, turn_rad=0.7)
    K = np.array([[700.0, 0, 320], [0, 700, 180], [0, 0, 1]])
    camera = ClipCamera("v1", K, np.ones(1), (640, 360), np.eye(3)[None], np.zeros((1, 3)))
    return Actor(as_rig(made.clip, names), skin_of(made.shaped), camera, (0.2, 0.3, 0.6))


def retarget(file: Path, out: Path, *words: str) -> subprocess.CompletedProcess[str]:
    command = [str(BLENDER), str(EXAMPLE), str(file), "--out", str(out), *words]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("format", ["fbx", "glb"])
def test_the_rigs_arms_point_where_the_performers_do(tmp_path: Path, format: str) -> None:
    file = tmp_path / "v1.glb"
    if format == "fbx":
        program = Path(str(BLENDER))
        (file,) = write_characters(program, tmp_path, [actor("rigify")], "fbx", {})
    else:
        write_glb(file, [actor("rigify")], {})
    done = retarget(file, tmp_path / "out", "--pictures", "1", "--size", "64", "48")
    assert done.returncode == 0, done.stderr
    found = re.search(r"8 frames; arms within ([0-9.]+) degrees, legs within", done.stdout)
    assert found is not None, done.stdout
    assert float(found[1]) < 0.05
    assert (tmp_path / "out" / "character.blend").stat().st_size > 100_000
    (picture,) = (tmp_path / "out").glob("frame_*.png")
    pixels = cv2.imread(str(picture))
    assert pixels.shape == (48, 64, 3)
    blue, red = pixels[..., 0].astype(int), pixels[..., 2].astype(int)
    assert (red - blue > 40).any()  # the character
    assert (blue - red > 40).any()  # the performer beside it


def test_other_names_are_refused_with_a_sentence(tmp_path: Path) -> None:
    file = tmp_path / "v1.glb"
    write_glb(file, [actor("mixamo")], {})
    done = retarget(file, tmp_path / "out", "--pictures", "0")
    assert done.returncode == 1
    assert "export it with --names rigify" in done.stderr
    assert "Traceback" not in done.stderr
