"""Captured motion on the body: what a made skeleton does, the body does."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from benchmarks.synthetic.arm_twist import ELEVATION_DEG, TWIST_DEG, natural_arm
from benchmarks.synthetic.captured_rotations import rotations_between, trunk_bone_rotations
from benchmarks.synthetic.captured_stance import (
    CapturedSkeleton,
    NeutralStance,
    angles_rad,
    captured_skeleton,
    neutral_stance,
    standing_frames,
)
from benchmarks.synthetic.retargeting import (
    SPINE_SHARES,
    fit_to_trunk_and_joints,
    trunk_and_joints,
)
from imocap_core.body import load_free_body
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.prior import load_pose_prior
from imocap_core.motion.state import Body
from imocap_core.rotations import exp, log

FRAMES = 40
WORLD_FROM_BODY = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # z up from y up
PARENTS = {
    "hip": None, "abdomen": "hip", "chest": "abdomen", "neck": "chest", "head": "neck",
    "leftEye": "head", "rightEye": "head",
    **{f"{s}{part}": f"{s}{parent}" if parent[0].isupper() else parent
       for s in "lr" for part, parent in (
           ("Collar", "chest"), ("Shldr", "Collar"), ("ForeArm", "Shldr"), ("Hand", "ForeArm"),
           ("Mid1", "Hand"), ("Buttock", "hip"), ("Thigh", "Buttock"), ("Shin", "Thigh"),
           ("Foot", "Shin"), ("Foot_end", "Foot"))},
}  # fmt: skip
NAMES = list(PARENTS)
LIMBS = {"Shldr": "shoulder", "ForeArm": "elbow", "Hand": "wrist", "Mid1": "hand", "Thigh": "hip",
         "Shin": "knee", "Foot": "ankle", "Foot_end": "foot"}  # fmt: skip
# Places of a made skeleton that no body joint has: (SMPL joint they turn with, offset in metres).
ATTACHED = {
    "hip": ("pelvis", (0.0, -0.06, 0.02)), "abdomen": ("pelvis", (0.0, 0.14, 0.0)),
    "lButtock": ("pelvis", (0.09, -0.03, 0.01)), "rButtock": ("pelvis", (-0.09, -0.03, 0.01)),
    "chest": ("spine3", (0.0, -0.1, 0.0)), "neck": ("spine3", (0.0, 0.14, 0.0)),
    "lCollar": ("spine3", (0.03, 0.1, -0.02)), "rCollar": ("spine3", (-0.03, 0.1, -0.02)),
    "head": ("head", (0.0, 0.02, 0.0)), "leftEye": ("head", (0.03, 0.1, 0.08)),
    "rightEye": ("head", (-0.03, 0.1, 0.08)),
}  # fmt: skip


def performed(seed: int, size: float = 0.4) -> np.ndarray:
    """Local rotations (T, 24, 3) of a made motion: arms hang, trunk and limbs move smoothly."""
    rng, t = np.random.default_rng(seed), np.linspace(0.0, 1.0, FRAMES)[:, None]
    theta = np.zeros((FRAMES, 24, 3))
    index = SMPL_JOINTS.index
    theta[:, index("left_shoulder"), 2], theta[:, index("right_shoulder"), 2] = -1.2, 1.2
    spine = size * rng.normal(size=3) * np.sin(3 * t)
    for joint, share in zip(("spine1", "spine2", "spine3"), SPINE_SHARES, strict=True):
        theta[:, index(joint)] = spine * share
    for name in ("left_hip", "right_hip", "left_shoulder", "right_shoulder"):
        theta[:, index(name)] += size * rng.normal(size=3) * np.sin(2 * t + rng.uniform())
    for name, axis, sign in (("left_knee", 0, 1), ("right_knee", 0, 1),
                             ("left_elbow", 1, -1), ("right_elbow", 1, 1)):  # fmt: skip
        theta[:, index(name), axis] = sign * (0.1 + size * (1 + np.sin(2 * t[:, 0])))
    theta[:, 0] = size * rng.normal(size=3) * np.sin(t)
    return theta


def captured(theta: np.ndarray) -> np.ndarray:
    """Joints (T, J, 3), z up, of the made skeleton that performs a motion of the free body."""
    shaped = load_free_body().shape(torch.zeros(10, dtype=torch.float64))
    posed = shaped.pose(exp(torch.as_tensor(theta)), torch.zeros(len(theta), 3).double())
    joints, R = posed.joints.numpy(), posed.R_world.numpy()
    places = []
    for name in NAMES:
        if name in ATTACHED:
            joint, offset = ATTACHED[name]
            k = SMPL_JOINTS.index(joint)
            places.append(joints[:, k] + R[:, k] @ np.array(offset))
        else:
            side = {"l": "left", "r": "right"}[name[0]]
            places.append(joints[:, SMPL_JOINTS.index(f"{side}_{LIMBS[name[1:]]}")])
    return np.stack(places, 1) @ WORLD_FROM_BODY.T


def stance_and_skeleton() -> tuple[NeutralStance, CapturedSkeleton]:
    skeleton = captured_skeleton(
        NAMES, [-1 if p is None else NAMES.index(p) for p in PARENTS.values()]
    )
    return neutral_stance(skeleton, [captured(np.zeros((5, 24, 3)))]), skeleton


def test_the_trunk_turns_as_the_captured_one() -> None:
    stance, skeleton = stance_and_skeleton()
    theta = performed(3)
    shaped = load_free_body().shape(torch.zeros(10, dtype=torch.float64))
    result = trunk_and_joints(shaped, skeleton, stance, captured(theta))
    R_true = exp(torch.as_tensor(theta)).numpy()
    np.testing.assert_allclose(result.R_local[:, 0], WORLD_FROM_BODY @ R_true[:, 0], atol=1e-6)
    spine = [SMPL_JOINTS.index(f"spine{k}") for k in (1, 2, 3)]
    a, b, c = (result.R_local[:, k] for k in spine)
    d, e, f = (R_true[:, k] for k in spine)
    np.testing.assert_allclose(a @ b @ c, d @ e @ f, atol=1e-6)
    bent = log(torch.as_tensor(result.R_local[:, spine])).norm(dim=-1).numpy()
    assert (bent < 0.6 * bent.sum(1, keepdims=True) + 1e-9).all()  # the bend is shared
    assert bent.sum(1).max() > 0.2


@pytest.mark.parametrize("seed", [4, 7])
def test_limbs_point_where_the_captured_ones_do(seed: int) -> None:
    stance, skeleton = stance_and_skeleton()
    model = load_free_body()
    betas = torch.zeros(10, dtype=torch.float64)
    xyz = captured(performed(seed))
    wanted = trunk_and_joints(model.shape(betas), skeleton, stance, xyz)
    state = fit_to_trunk_and_joints(Body.of(model, "smpl24"), [wanted], betas)
    joints = model.shape(betas).pose(state.R_local[0], state.trans[0]).joints.numpy()
    for side, c in (("left", "l"), ("right", "r")):
        for near, far, a, b in (("hip", "knee", "Thigh", "Shin"), ("knee", "ankle", "Shin", "Foot"),
                                ("shoulder", "elbow", "Shldr", "ForeArm")):  # fmt: skip
            ours = joints[:, SMPL_JOINTS.index(f"{side}_{far}")]
            ours = ours - joints[:, SMPL_JOINTS.index(f"{side}_{near}")]
            theirs = xyz[:, NAMES.index(c + b)] - xyz[:, NAMES.index(c + a)]
            cosine = (ours * theirs).sum(1) / np.linalg.norm(ours, axis=1)
            angle = np.degrees(np.arccos(np.clip(cosine / np.linalg.norm(theirs, axis=1), -1, 1)))
            assert angle.mean() < 4.5, (side, far)
    hips = [SMPL_JOINTS.index(f"{side}_hip") for side in ("left", "right")]
    middle = xyz[:, [NAMES.index("lThigh"), NAMES.index("rThigh")]].mean(1)
    np.testing.assert_allclose(joints[:, hips].mean(1), middle, atol=0.02)


def test_a_bent_elbow_turns_the_upper_arm_and_bends_about_its_hinge() -> None:
    stance, skeleton = stance_and_skeleton()
    model = load_free_body()
    betas = torch.zeros(10, dtype=torch.float64)
    theta = np.zeros((FRAMES, 24, 3))
    arm, elbow = (SMPL_JOINTS.index(f"left_{name}") for name in ("shoulder", "elbow"))
    turned = exp(torch.tensor([[0.0, 0.0, -0.4], [-0.9, 0.0, 0.0]], dtype=torch.float64))
    theta[:, arm] = log(turned[0] @ turned[1]).numpy()
    theta[:, elbow, 1] = -1.2
    wanted = trunk_and_joints(model.shape(betas), skeleton, stance, captured(theta))
    state = fit_to_trunk_and_joints(Body.of(model, "smpl24"), [wanted], betas)
    fitted = state.axis_angle[0, FRAMES // 2].numpy()
    assert abs(fitted[elbow, 2]) < 0.15  # sideways
    np.testing.assert_allclose(fitted[elbow, 1], -1.2, atol=0.15)
    np.testing.assert_allclose(fitted[arm], theta[0, arm], atol=0.2)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_straight_arm_turns_as_bent_ones_of_its_elevation(side: float) -> None:
    elevation = np.radians(ELEVATION_DEG)
    direction = np.stack([side * np.cos(elevation), np.sin(elevation), 0 * elevation], 1)
    R = natural_arm(np.array([side * 0.25, 0.0, 0.0]), direction)
    np.testing.assert_allclose(R @ [side, 0.0, 0.0], direction, atol=1e-9)
    untwisted = exp(torch.as_tensor(side * elevation[:, None] * [0.0, 0.0, 1.0])).numpy()
    twist = log(torch.as_tensor(untwisted.swapaxes(1, 2) @ R)).numpy()[:, 0]
    np.testing.assert_allclose(np.degrees(twist), TWIST_DEG, atol=1e-6)


def test_a_straightened_forearm_takes_its_hand_along() -> None:
    skeleton = stance_and_skeleton()[1]
    xyz = captured(np.zeros((5, 24, 3)))
    for side, sign in (("l", 1.0), ("r", -1.0)):  # elbows behind straight arms look bent
        xyz[:, NAMES.index(f"{side}ForeArm")] += [0.0, 0.04, 0.02 * sign]
    stance = neutral_stance(skeleton, [xyz])
    assert stance.bend_rad["wrist"] > 0.2
    shaped = load_free_body().shape(torch.zeros(10, dtype=torch.float64))
    wanted, rest = trunk_and_joints(shaped, skeleton, stance, xyz).joints, shaped.joints_rest
    for side in ("left", "right"):
        elbow, wrist, hand = (SMPL_JOINTS.index(f"{side}_{n}") for n in ("elbow", "wrist", "hand"))
        forearm, palm = wanted[:, wrist] - wanted[:, elbow], wanted[:, hand] - wanted[:, wrist]
        at_rest = rest.numpy()[[hand, wrist]] - rest.numpy()[[wrist, elbow]]
        expected = np.full(len(xyz), angles_rad(*at_rest))
        np.testing.assert_allclose(angles_rad(forearm, palm), expected, atol=0.02)


def test_turning_the_world_turns_the_root_alone() -> None:
    stance, skeleton = stance_and_skeleton()
    shaped = load_free_body().shape(torch.zeros(10, dtype=torch.float64))
    xyz = captured(performed(5))
    turn = exp(torch.tensor([0.0, 0.0, 1.1], dtype=torch.float64)).numpy()
    straight, turned = (trunk_and_joints(shaped, skeleton, stance, x) for x in (xyz, xyz @ turn.T))
    np.testing.assert_allclose(turned.R_local[:, 1:], straight.R_local[:, 1:], atol=1e-6)
    np.testing.assert_allclose(turned.R_local[:, 0], turn @ straight.R_local[:, 0], atol=1e-6)
    np.testing.assert_allclose(turned.joints, straight.joints @ turn.T, atol=1e-6)


def test_rotations_between_vectors_are_recovered() -> None:
    rng = np.random.default_rng(0)
    template = rng.normal(size=(4, 3))
    R = exp(torch.as_tensor(rng.normal(size=(6, 3)))).numpy()
    observed = np.einsum("tij,cj->tci", R, template)
    np.testing.assert_allclose(rotations_between(template, observed), R, atol=1e-9)


def test_neck_and_collars_point_where_the_captured_bones_do() -> None:
    stance, skeleton = stance_and_skeleton()
    xyz = captured(performed(6))
    rotations = trunk_bone_rotations(skeleton, stance, xyz)
    for R, (name, template) in zip(rotations, stance.trunk_bones.items(), strict=True):
        np.testing.assert_allclose(R @ template, skeleton.trunk_bone(xyz, name), atol=1e-9)
        np.testing.assert_allclose(np.linalg.det(R), 1.0, atol=1e-9)
    standing = captured(np.zeros((3, 24, 3)))
    for R in trunk_bone_rotations(skeleton, stance, standing):
        np.testing.assert_allclose(R, np.tile(WORLD_FROM_BODY, (3, 1, 1)), atol=0.01)


def test_who_never_stands_has_no_stance() -> None:
    _, skeleton = stance_and_skeleton()
    lying = captured(np.zeros((5, 24, 3))) @ np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    assert not standing_frames(skeleton, lying).any()
    with pytest.raises(ValueError, match="standing upright"):
        neutral_stance(skeleton, [lying])
    with pytest.raises(ValueError, match="CMU's or OptiTrack's"):
        captured_skeleton(["a", "b"], [-1, 0])


def test_the_shipped_prior_stands_upright() -> None:
    """Its spine is near rest: no component folds the trunk to reach captured joint centres."""
    prior = load_pose_prior()
    mean = np.degrees(prior.mean.reshape(-1, 23, 3).norm(dim=-1).numpy())
    share = prior.weight.numpy()
    for name, limit in (("spine1", 12), ("spine2", 12), ("spine3", 12), ("left_collar", 10)):
        assert (share * mean[:, SMPL_JOINTS.index(name) - 1]).sum() < limit


def test_the_shipped_prior_has_straight_wrists() -> None:
    """On average nobody bends the wrists sideways (about y, palms down) by more than they can."""
    prior = load_pose_prior()
    share = (prior.weight / prior.weight.sum()).numpy()
    mean = np.degrees(share @ prior.mean.numpy()).reshape(23, 3)
    for side in ("left", "right"):
        assert abs(mean[SMPL_JOINTS.index(f"{side}_wrist") - 1, 1]) < 15
