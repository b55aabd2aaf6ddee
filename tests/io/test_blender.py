"""BVH, GLB, FBX and USD read by Blender itself, FBX and USD by other readers too.

Needs IMOCAP_BLENDER: an interpreter that has `bpy`; and for the others IMOCAP_READERS: one that has
ufbx, usd-core and numpy.
"""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from imocap_core.export.blender import write_characters
from imocap_core.export.clips import with_root_bone
from imocap_core.io.writers.bvh import write_bvh
from imocap_core.io.writers.gltf import Actor, ClipCamera, skin_of, write_glb
from imocap_core.io.writers.motion_clip import MotionClip, upright_rest
from imocap_core.io.writers.rigs import as_rig
from tests.io.made_clips import Made, made_clip
from tools import check_characters
from tools.check_in_blender import blender_axes, joint_error_m, read_in_blender

READERS = os.environ.get("IMOCAP_READERS")
BLENDER = os.environ.get("IMOCAP_BLENDER")
pytestmark = pytest.mark.skipif(
    BLENDER is None, reason="IMOCAP_BLENDER names no interpreter with bpy"
)
FRAMES = np.array([0, 4, 11])


def actor(made: Made, clip: MotionClip) -> Actor:
    K = np.array([[700.0, 0, 320], [0, 700, 180], [0, 0, 1]])
    camera = ClipCamera("v1", K, np.ones(1), (640, 360), np.eye(3)[None], np.zeros((1, 3)))
    skin = skin_of(made.shaped)
    rooted = replace(skin, joints=skin.joints + 1) if clip.root is not None else skin
    return Actor(clip, rooted, camera, (0.5, 0.5, 0.5))


@pytest.mark.parametrize(("format", "up"), [("bvh", "y"), ("bvh", "z"), ("glb", "y")])
def test_joints_within_a_tenth_of_a_millimetre(tmp_path: Path, format: str, up: str) -> None:
    made = made_clip(hands=True)
    file = tmp_path / f"v1.{format}"
    if format == "bvh":
        write_bvh(file, upright_rest(made.clip, up))
    else:
        write_glb(file, [actor(made, made.clip)], {})
    in_blender = read_in_blender(Path(str(BLENDER)), file, 30, FRAMES.tolist(), up)
    assert 1000 * joint_error_m(made.clip, FRAMES, in_blender, up) < 0.1


@pytest.mark.parametrize("format", ["fbx", "usd"])
def test_what_blender_converts_is_the_same_motion(tmp_path: Path, format: str) -> None:
    made = made_clip(hands=True, fps=25.0)
    clip = with_root_bone(as_rig(made.clip, "mixamo"), "y")
    (file,) = write_characters(Path(str(BLENDER)), tmp_path, [actor(made, clip)], format, {})
    read = read_in_blender(Path(str(BLENDER)), file, 30, FRAMES.tolist(), "y")
    fps = read.pop("fps")
    assert fps == pytest.approx(25.0 if format == "fbx" else 30.0)  # of USD it stays the scene's
    assert not read.pop("cameras")
    (joints,) = read.values()
    ours = clip.joints[FRAMES]
    assert check_characters.joint_error_m(blender_axes(ours, "y"), clip, joints) < 1e-4
    if READERS is None:
        pytest.skip("IMOCAP_READERS names no interpreter with ufbx and usd-core")
    other = check_characters.read_elsewhere(Path(READERS), file, FRAMES)
    metres = {name: other["metres"] * np.array(path) for name, path in other["joints"].items()}
    assert check_characters.joint_error_m(ours, clip, metres) < 1e-4
    assert (other["fps"], other["up"]) == (pytest.approx(25.0), "y")
    assert other["metres"] == pytest.approx(0.01 if format == "fbx" else 1.0)
    assert other["seconds"] == pytest.approx((len(clip.frames) - 1) / 25.0)
    assert other["materials"] == ["v1"]
    assert other["skinned"] == len(clip.parents)
