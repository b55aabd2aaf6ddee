"""Names, rest pose, root bone and unit of characters: the motion stays the same."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from imocap_core.camera.gravity import heading
from imocap_core.export.clips import with_root_bone
from imocap_core.io.writers.bvh import bvh_text
from imocap_core.io.writers.gltf import skin_of
from imocap_core.io.writers.motion_clip import MotionClip, scaled, upright_rest
from imocap_core.io.writers.rigs import RIGS, as_rig, skin_as_rig
from imocap_core.rotations import exp
from tests.io.made_clips import made_clip


def clip_of(hands: bool, up: str = "y") -> MotionClip:
    clip = made_clip(frames=6, hands=hands, turn_rad=0.6).clip
    if up == "y":
        return clip
    quarter = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    R = clip.R_local.copy()
    R[:, 0] = quarter @ R[:, 0]
    return replace(clip, R_local=R, pelvis=clip.pelvis @ quarter.T)


@pytest.mark.parametrize("rig", list(RIGS))
@pytest.mark.parametrize("hands", [False, True])
def test_a_rig_has_other_names_and_the_same_motion(rig: str, hands: bool) -> None:
    clip = clip_of(hands)
    posed = as_rig(clip, rig)
    np.testing.assert_allclose(posed.joints, clip.joints, atol=1e-12)
    assert len(set(posed.joint_names)) == len(posed.joint_names)
    assert not set(posed.joint_names) & {n for n in clip.joint_names if n.startswith("left")}


def test_names_are_those_of_the_rigs() -> None:
    clip = clip_of(hands=True)
    named = {
        rig: dict(zip(clip.joint_names, as_rig(clip, rig).joint_names, strict=True)) for rig in RIGS
    }
    assert named["mixamo"]["left_shoulder"] == "mixamorig:LeftArm"
    assert named["mixamo"]["right_index2"] == "mixamorig:RightHandIndex2"
    assert named["ue5"]["right_knee"] == "calf_r"
    assert named["ue5"]["left_thumb3"] == "thumb_03_l"
    assert named["rigify"]["left_elbow"] == "forearm.L"
    assert named["rigify"]["right_pinky1"] == "f_pinky.01.R"


def test_arms_of_the_mannequin_hang_down_at_rest_and_the_skin_with_them() -> None:
    made = made_clip()
    clip = made.clip
    posed = as_rig(clip, "ue5")
    shoulder, wrist = (clip.joint_names.index(f"left_{j}") for j in ("shoulder", "wrist"))
    arm, before = (c.rest[wrist] - c.rest[shoulder] for c in (posed, clip))
    assert np.degrees(np.arctan2(-arm[1], arm[0]) - np.arctan2(-before[1], before[0])) == (
        pytest.approx(45, abs=1e-9)
    )
    skin = skin_of(made.shaped)
    hanging = skin_as_rig(skin, clip, "ue5")
    hand = (skin.weights * (skin.joints == wrist)).sum(1) > 0.95
    assert hand.any()
    np.testing.assert_allclose(
        np.linalg.norm(hanging.vertices[hand] - posed.rest[wrist], axis=1),
        np.linalg.norm(skin.vertices[hand] - clip.rest[wrist], axis=1),
        atol=0.02,
    )
    assert skin_as_rig(skin, clip, "mixamo") is skin


@pytest.mark.parametrize("up", ["y", "z"])
def test_a_root_bone_is_on_the_floor_and_turns_about_the_vertical_only(up: str) -> None:
    clip = clip_of(hands=False, up=up)
    rooted = with_root_bone(clip, up)
    np.testing.assert_allclose(rooted.joints[:, 1:], clip.joints, atol=1e-12)
    axis = "xyz".index(up)
    np.testing.assert_allclose(rooted.root[:, axis], 0)
    np.testing.assert_allclose(np.delete(rooted.root - clip.pelvis, axis, axis=1), 0, atol=1e-12)
    upright = upright_rest(rooted, up)
    vertical = np.eye(3)[axis]
    np.testing.assert_allclose(
        upright.R_local[:, 0] @ vertical, np.tile(vertical, (6, 1)), atol=1e-9
    )


def test_the_file_of_a_root_bone_puts_joints_where_they_are() -> None:
    rooted = with_root_bone(clip_of(hands=False), "y")
    text = bvh_text(scaled(rooted, 100.0))
    assert text.startswith("HIERARCHY\nROOT root\n")
    row = np.array(text.splitlines()[-1].split(), float)
    assert len(row) == 3 * len(rooted.parents) + 6
    np.testing.assert_allclose(row[:3], 100 * rooted.root[-1], atol=1e-5)
    np.testing.assert_allclose(row[6:9], 100 * rooted.pelvis_from_root[-1], atol=1e-5)


def test_a_heading_does_not_jump_when_somebody_spins() -> None:
    angles = np.radians(np.arange(0, 1000, 15.0))
    turning = exp(torch.as_tensor(np.stack([0 * angles, angles, 0 * angles], 1))).numpy()
    np.testing.assert_allclose(heading(turning), turning, atol=1e-9)
