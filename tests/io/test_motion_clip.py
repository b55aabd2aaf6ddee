"""Motion clips: the body's kinematics, whichever rest pose they are written with."""

from dataclasses import replace

import numpy as np
import pytest

from imocap_core.io.writers.gltf import skin_of
from imocap_core.io.writers.motion_clip import upright_rest
from tests.io.made_clips import made_clip


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
