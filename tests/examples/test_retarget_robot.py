"""The example that puts a motion onto a robot. Needs mujoco, mink, daqp and robosuite-models."""

import importlib
import importlib.util
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imocap_core.io.writers.bvh import as_lafan1, write_bvh
from imocap_core.io.writers.motion_clip import scaled
from tests.io.made_clips import made_clip

mujoco: Any = pytest.importorskip("mujoco", reason="mujoco is not installed")
pytest.importorskip("mink", reason="mink is not installed")
pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("robosuite_models") is None, reason="robosuite-models is not installed"
)
EXAMPLES = Path(__file__).parents[2] / "examples"


def test_a_body_that_stands_still_is_a_robot_that_stands(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(EXAMPLES)
    robot = importlib.import_module("retarget_robot")
    clip = made_clip(frames=4).clip
    still = replace(
        clip,
        R_local=np.tile(np.eye(3), (*clip.R_local.shape[:2], 1, 1)),
        pelvis=np.tile([0.0, 0.95, 0.0], (4, 1)),
    )
    write_bvh(tmp_path / "still.bvh", scaled(as_lafan1(still), 100.0))
    motion = robot.read_bvh(tmp_path / "still.bvh")
    head = clip.rest[clip.joint_names.index("head")]
    np.testing.assert_allclose(motion.places["Head"][0, 2], 0.95 + head[1], atol=1e-3)
    model = robot.load_robot()
    qpos = robot.retarget(model, motion)
    data = mujoco.MjData(model)
    data.qpos[:] = qpos[-1]
    mujoco.mj_kinematics(model, data)
    torso = data.body("torso_link").xmat.reshape(3, 3)
    np.testing.assert_allclose(torso[:, 2], [0, 0, 1], atol=0.1)  # upright
    for side, y in (("l", 1), ("r", -1)):
        hand, foot = (data.body(f"{side}_{n}_link").xpos for n in ("elbow_roll", "ankle_roll"))
        away = torso.T @ (hand - data.body("pelvis").xpos)
        assert y * away[1] > 0.4  # T pose
        assert foot[2] < 0.08
    assert robot.measure(model, qpos, 30.0)["largest, mm"] < 10
