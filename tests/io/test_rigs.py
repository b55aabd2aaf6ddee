"""Motion clips and characters: the body's kinematics, whichever rest pose, names, root bone and
unit they are written with."""

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


@pytest.mark.parametrize("hands", [False, True])
def test_joints_are_the_bodys(hands: bool) -> None:
    made = made_clip(hands=hands)
    np.testing.assert_allclose(made.clip.joints, made.posed.joints.numpy(), atol=1e-12)


def test_an_upright_rest_pose_changes_no_joint() -> None:
    clip = made_clip().clip
    turned = upright_rest(clip, "z")
    np.testing.assert_allclose(turned.joints, clip.joints, atol=1e-12)
    head = clip.joint_names.index("head")
    assert clip.rest[head, 1] > 0.4
    assert turned.rest[head, 2] == pytest.approx(clip.rest[head, 1])
    foot = clip.joint_names.index("left_foot")
    assert turned.rest[foot, 1] == pytest.approx(-clip.rest[foot, 2])  # faces -y
    assert upright_rest(clip, "y") is clip
    with pytest.raises(ValueError, match="up: expected y or z"):
        upright_rest(clip, "x")


def test_tips_go_on_to_the_ends_of_the_body() -> None:
    made = made_clip(hands=True)
    clip = made.clip
    names = {clip.joint_names[j]: tip for j, tip in clip.tips.items()}
    assert set(names) == {"head", "left_foot", "right_foot"} | {
        f"{side}_{finger}3"
        for side in ("left", "right")
        for finger in ("index", "middle", "pinky", "ring", "thumb")
    }
    top = made.shaped.vertices_rest[:, 1].max() - made.shaped.joints_rest[0, 1]
    head = clip.rest[clip.joint_names.index("head")] + names["head"]
    assert abs(head[1] - float(top)) < 0.02
    assert 0.01 < np.linalg.norm(names["left_index3"]) < 0.04


@pytest.mark.usefixtures("unchecked_shapes")
def test_arrays_of_different_lengths_are_refused() -> None:
    clip = made_clip().clip
    with pytest.raises(ValueError, match=r"clip v1: pelvis: expected \(12, 3\), got \(11, 3\)"):
        replace(clip, pelvis=clip.pelvis[1:])
    with pytest.raises(ValueError, match="fps: expected > 0, got 0"):
        replace(clip, fps=0.0)


def test_the_free_bodys_skin_needs_no_more_than_four_joints() -> None:
    """So that linear skinning of the file is the body itself: no weight is lost."""
    made = made_clip(hands=True, turn_rad=0.5)
    skin = skin_of(made.shaped)
    full = np.zeros(made.shaped.model.weights.shape)
    np.add.at(full, (np.arange(len(full))[:, None], skin.joints), skin.weights)
    np.testing.assert_allclose(full, made.shaped.model.weights.numpy(), atol=1e-9)
