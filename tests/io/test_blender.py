"""BVH and GLB read by Blender itself. Needs IMOCAP_BLENDER: an interpreter that has `bpy`."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from imocap_core.io.writers.bvh import write_bvh
from imocap_core.io.writers.clip_body import ClipCamera, skin_of
from imocap_core.io.writers.gltf_scene import Actor, write_glb
from imocap_core.io.writers.motion_clip import upright_rest
from tests.io.made_clips import made_clip
from tools.check_in_blender import joint_error_m, read_in_blender

BLENDER = os.environ.get("IMOCAP_BLENDER")
pytestmark = pytest.mark.skipif(
    BLENDER is None, reason="IMOCAP_BLENDER names no interpreter with bpy"
)
FRAMES = np.array([0, 4, 11])


@pytest.mark.parametrize(("format", "up"), [("bvh", "y"), ("bvh", "z"), ("glb", "y")])
def test_joints_within_a_tenth_of_a_millimetre(tmp_path: Path, format: str, up: str) -> None:
    made = made_clip(hands=True)
    file = tmp_path / f"v1.{format}"
    if format == "bvh":
        write_bvh(file, upright_rest(made.clip, up))
    else:
        K = np.array([[700.0, 0, 320], [0, 700, 180], [0, 0, 1]])
        camera = ClipCamera("v1", K, np.ones(1), (640, 360), np.eye(3)[None], np.zeros((1, 3)))
        write_glb(file, [Actor(made.clip, skin_of(made.shaped), camera, (0.5, 0.5, 0.5))], {})
    in_blender = read_in_blender(Path(str(BLENDER)), file, 30, FRAMES.tolist(), up)
    assert 1000 * joint_error_m(made.clip, FRAMES, in_blender, up) < 0.1
