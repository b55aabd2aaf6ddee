"""Captured motion on the body: orientations of segments transfer, places of joints do not.

Pelvis, chest and head turn as the captured ones do against the neutral stance. The turn from pelvis
to chest is shared by the three joints of the spine, the turn from chest to head by neck and head.
Limbs point where the captured bones point, straightened by what a straight captured limb is bent
more than the body's at rest; hands turn with a straightened forearm, feet stay on the ground.
Elbows and knees are hinges, so a bent one tells how the upper arm or the thigh is turned about
itself; of a straight arm it is what bent arms of that elevation tell.

The shares of the spine and the rise of the collars are rounded choices. They follow what is
reported of lumbar and thoracic ranges (White & Panjabi, Clinical Biomechanics of the Spine, 1990)
and of the clavicle when the arm rises (Ludewig et al., J. Bone Joint Surg. Am. 91:378-389, 2009),
and were not compared with the printed tables.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from benchmarks.synthetic.captured_skeleton import (
    NEAR_END,
    CapturedSkeleton,
    NeutralStance,
    angles_rad,
    natural_arm,
    rotations_from_stance,
)
from imocap_core.body.model import Model, Shaped
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.gauss_newton import gauss_newton
from imocap_core.motion.prior import PosePrior, mixture
from imocap_core.motion.state import Body, MotionState
from imocap_core.motion.terms import (
    HingeLimits,
    JointEvidence,
    PoseCoupling,
    PosePriorTerm,
    PoseSmoothness,
    Term,
)
from imocap_core.rotations import exp, log

# Of spine1, spine2, spine3: flexion (about x), axial rotation (y), side bend (z).
SPINE_SHARES = np.array([[0.45, 0.15, 0.35], [0.30, 0.35, 0.35], [0.25, 0.50, 0.30]])
NECK_SHARE = 0.5
COLLAR_SHARE, COLLAR_FROM_DEG = 0.1, 30.0  # radians of rise per radian of the arm's elevation
TRUNK = ("pelvis", "spine1", "spine2", "spine3", "neck", "head", "left_collar", "right_collar")
TRUNK_SPREAD_RAD = 0.01
LIMB_SPREAD_M, END_SPREAD_M = 0.01, 0.02
ENDS = ("foot", "hand")
TWIST_SPREAD_RAD, END_TWIST_SPREAD_RAD = 0.8, 0.3  # about rest, of what bones alone do not tell
THIGH_TWIST_SPREAD_RAD = 0.4
SIDEWAYS_SPREAD_RAD = {"elbow": 0.1, "knee": 0.15}  # of a hinge
ARM_TWIST_WEIGHT = 0.5
TWIST_AXIS = {"elbow": 0, "knee": 1}  # along the limb in the T-pose
FREE_RAD = 10.0
ROBUST_SIGMA = 10.0
MAX_STEPS = 25


@dataclass(frozen=True)
class TrunkAndJoints:
    """What a capture says of a body: the trunk's local rotations and where every joint belongs.

    Attributes:
        R_local: (T, 24, 3, 3): the trunk's, and where straight arms turn; the identity elsewhere.
        joints: (T, 24, 3) metres, with the body's own bone lengths.
    """

    R_local: Float[np.ndarray, "T 24 3 3"]
    joints: Float[np.ndarray, "T 24 3"]


def trunk_and_joints(
    shaped: Shaped,
    skeleton: CapturedSkeleton,
    stance: NeutralStance,
    xyz: Float[np.ndarray, "T J 3"],
) -> TrunkAndJoints:
    """A capture (z up, metres) transferred to a body of a certain shape; hips where they were."""
    R_local = _trunk(skeleton, stance, xyz)
    parents = shaped.model.parents
    rest = shaped.joints_rest.detach().cpu().numpy().reshape(-1, 3)
    R_world, joints = R_local.copy(), np.zeros((len(xyz), 24, 3))
    for joint, parent in enumerate(parents):
        if parent < 0:
            continue
        R_world[:, joint] = R_world[:, parent] @ R_local[:, joint]
        bone, name = rest[joint] - rest[parent], SMPL_JOINTS[joint]
        if name in skeleton.bones:
            direction = skeleton.bone(xyz, name)
            for end in (joint, parent) if name.endswith("hand") else (joint,):
                back = _excess_bend(rest, parents, stance, end)
                straighten = _straightening(skeleton, xyz, SMPL_JOINTS[end], back)
                direction = (straighten @ direction[..., None])[..., 0]
            offset = np.linalg.norm(bone) * direction
            if name.endswith("elbow"):
                chest = R_world[:, SMPL_JOINTS.index("spine3")]
                arm = chest @ natural_arm(bone, np.einsum("tji,tj->ti", chest, direction))
                R_local[:, parent] = R_world[:, parent].swapaxes(1, 2) @ arm
        else:
            offset = R_world[:, parent] @ bone
        joints[:, joint] = joints[:, parent] + offset
    hips = [SMPL_JOINTS.index(f"{side}_hip") for side in ("left", "right")]
    captured = [skeleton.place(xyz, skeleton.bones[f"{s}_knee"][0]) for s in ("left", "right")]
    shift = np.mean(captured, axis=0) - joints[:, hips].mean(1)
    return TrunkAndJoints(R_local, joints + shift[:, None])


def fit_to_trunk_and_joints(
    body: Body, motions: Sequence[TrunkAndJoints], betas: Float[Tensor, "_"]
) -> MotionState:
    """The body's motions (batch of all clips): trunk as given, limbs by their joints."""
    longest, count = max(len(m.joints) for m in motions), len(motions)
    eye = torch.eye(3, dtype=torch.float64).expand(count, longest, 24, 3, 3)
    R_local, joints = eye.clone(), torch.zeros(count, longest, 24, 3, dtype=torch.float64)
    hold = torch.zeros(count, longest, 24, dtype=torch.float64)
    weight, valid = torch.zeros_like(hold), torch.zeros(count, longest, dtype=torch.bool)
    for row, motion in enumerate(motions):
        frames = slice(0, len(motion.joints))
        R_local[row, frames] = torch.as_tensor(motion.R_local)
        joints[row, frames] = torch.as_tensor(motion.joints)
        hold[row, frames] = _hold_weights()
        weight[row, frames] = _limb_weights()
        valid[row, frames] = True
    ones = torch.ones(24, dtype=torch.float64)
    terms: list[Term] = [
        JointEvidence(body, joints, weight, ROBUST_SIGMA),
        PoseCoupling(R_local, hold),
        PosePriorTerm(_twist_prior(), 0.05),
        HingeLimits(100.0),
        PoseSmoothness(10.0 * ones, 0.0 * ones, 1.0),
    ]
    start = MotionState.of(R_local, joints[:, :, 0] * 0, betas.expand(count, -1).clone(), valid)
    fitted = gauss_newton(
        terms, start, max_steps=MAX_STEPS, relative_tolerance=1e-3, free_shape=False
    ).state
    posed = body.positions(body.joints, fitted)
    shift = (joints[:, :, :3] - posed[:, :, :3]).mean(2)
    return MotionState.of(fitted.R_local, fitted.trans + shift, fitted.betas, valid)


def _trunk(
    skeleton: CapturedSkeleton, stance: NeutralStance, xyz: np.ndarray
) -> Float[np.ndarray, "T 24 3 3"]:
    """Local rotations of pelvis (the world's axes to its own), spine, neck, head and collars."""
    pelvis, chest, head = rotations_from_stance(skeleton, stance, xyz)
    R = np.tile(np.eye(3), (len(xyz), 24, 1, 1))
    place = SMPL_JOINTS.index
    R[:, 0] = pelvis
    spine = pelvis.swapaxes(1, 2) @ chest
    lower, middle = (_exp(_log(spine) * share) for share in SPINE_SHARES[:2])
    R[:, place("spine1")], R[:, place("spine2")] = lower, middle
    R[:, place("spine3")] = (lower @ middle).swapaxes(1, 2) @ spine
    nod = chest.swapaxes(1, 2) @ head
    R[:, place("neck")] = _exp(_log(nod) * NECK_SHARE)
    R[:, place("head")] = R[:, place("neck")].swapaxes(1, 2) @ nod
    down = np.array([0.0, -1.0, 0.0])
    for side, sign in (("left", 1.0), ("right", -1.0)):
        arm = np.einsum("tji,tj->ti", chest, skeleton.bone(xyz, f"{side}_elbow"))
        above = np.clip(angles_rad(arm, down) - np.radians(COLLAR_FROM_DEG), 0.0, None)
        rise = sign * COLLAR_SHARE * above[:, None] * np.array([0.0, 0.0, 1.0])
        R[:, place(f"{side}_collar")] = _exp(rise)
    return R


def _excess_bend(
    rest: np.ndarray, parents: Sequence[int], stance: NeutralStance, joint: int
) -> float:
    """By how much a straight captured limb is bent more than the body's at rest, radians."""
    end = SMPL_JOINTS[joint].rpartition("_")[2]
    if end not in stance.bend_rad:
        return 0.0
    middle = parents[joint]
    bend = angles_rad(rest[[middle]] - rest[[parents[middle]]], rest[joint] - rest[middle])
    return max(stance.bend_rad[end] - float(bend[0]), 0.0)


def _straightening(
    skeleton: CapturedSkeleton, xyz: np.ndarray, far: str, back_rad: float
) -> np.ndarray:
    """(T, 3, 3) what straightens a limb by an angle, at most to straight; `far`: the SMPL joint at
    the end of the bone that turns."""
    if back_rad == 0.0:
        return np.tile(np.eye(3), (len(xyz), 1, 1))
    direction = skeleton.bone(xyz, far)
    side, _, end = far.partition("_")
    near = skeleton.bone(xyz, f"{side}_{NEAR_END[end]}")
    axis = np.cross(near, direction)
    axis /= np.maximum(np.linalg.norm(axis, axis=-1, keepdims=True), 1e-9)
    back = np.minimum(back_rad, angles_rad(near, direction))
    return _exp(-back[:, None] * axis)


def _hold_weights() -> Tensor:
    """(24,) 1/rad^2 of local rotations that are given: the trunk's, loosely the upper arms'."""
    weights = torch.zeros(24, dtype=torch.float64)
    for joint, name in enumerate(SMPL_JOINTS):
        if name in TRUNK:
            weights[joint] = TRUNK_SPREAD_RAD**-2
        elif name.endswith("shoulder"):
            weights[joint] = ARM_TWIST_WEIGHT
    return weights


def _limb_weights() -> Tensor:
    """(24,) 1/m^2 of the joints that place the limbs."""
    weights = torch.zeros(24, dtype=torch.float64)
    for joint, name in enumerate(SMPL_JOINTS):
        end = name.rpartition("_")[2]
        if end in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist"):
            weights[joint] = LIMB_SPREAD_M**-2
        elif end in ENDS:
            weights[joint] = END_SPREAD_M**-2
    return weights


def _twist_prior() -> PosePrior:
    """A wide Gaussian about the rest pose: holds what bones alone do not tell (twists), and
    elbows and knees to their hinges."""
    spread = np.full((23, 3), TWIST_SPREAD_RAD)
    for joint, name in enumerate(SMPL_JOINTS[1:]):
        end = name.rpartition("_")[2]
        if end in ("ankle", *ENDS):
            spread[joint] = END_TWIST_SPREAD_RAD
        elif end == "shoulder":
            spread[joint] = FREE_RAD
        elif end == "hip":
            spread[joint, 1] = THIGH_TWIST_SPREAD_RAD
        elif end in SIDEWAYS_SPREAD_RAD:
            spread[joint, TWIST_AXIS[end]] = END_TWIST_SPREAD_RAD
            spread[joint, 2] = SIDEWAYS_SPREAD_RAD[end]
    ones = np.ones(24)
    return mixture(np.zeros((1, 69)), np.diag(spread.ravel() ** 2)[None], np.ones(1), ones, ones)


def _exp(vectors: np.ndarray) -> np.ndarray:
    return exp(torch.as_tensor(vectors)).numpy()


def _log(rotations: np.ndarray) -> np.ndarray:
    return log(torch.as_tensor(rotations)).numpy()


# Performers of rendered videos: a body with a captured performer's limbs, moving as captured.
#
# The body's joints are the ground truth of the rendered videos; they differ from the captured ones
# because joint centres of two skeletons never coincide (`retargeting`).

BONES = {"knee": "hip", "ankle": "knee", "elbow": "shoulder", "wrist": "elbow"}  # far end: near end
LENGTH_SPREAD_M = 0.005
STEPS = 5


@dataclass(frozen=True)
class RetargetedMotion:
    """Local rotations and translation of a body, in the axes of the captured joints, metres."""

    R_local: Float[np.ndarray, "T 24 3 3"]
    transl: Float[np.ndarray, "T 3"]


def perform(
    model: Model,
    skeleton: CapturedSkeleton,
    stance: NeutralStance,
    clips: Sequence[Float[np.ndarray, "_ J 3"]],
) -> tuple[Float[np.ndarray, "10"], list[RetargetedMotion]]:
    """Shape and motions of one body that performs all clips of a performer.

    Args:
        clips: joints of the skeleton (T, J, 3) in metres, z up.

    Returns:
        The shape coefficients, and the motion of each clip.
    """
    betas = shape_of_limbs(model, limb_lengths_m(skeleton, clips))
    shaped = model.shape(betas)
    targets = [trunk_and_joints(shaped, skeleton, stance, clip) for clip in clips]
    fitted = fit_to_trunk_and_joints(Body.of(model, "smpl24"), targets, betas)
    motions = [
        RetargetedMotion(
            fitted.R_local[v, : len(clip)].numpy(), fitted.trans[v, : len(clip)].numpy()
        )
        for v, clip in enumerate(clips)
    ]
    return betas.numpy(), motions


def limb_lengths_m(
    skeleton: CapturedSkeleton, clips: Sequence[Float[np.ndarray, "_ J 3"]]
) -> dict[str, float]:
    """Median length of each bone of the limbs, left and right alike, by its far end."""
    lengths = {}
    for far in BONES:
        ends = [skeleton.bones[f"{side}_{far}"] for side in ("left", "right")]
        bones = [skeleton.place(x, b) - skeleton.place(x, a) for x in clips for a, b in ends]
        lengths[far] = float(np.median(np.linalg.norm(np.concatenate(bones), axis=-1)))
    return lengths


def shape_of_limbs(model: Model, lengths_m: Mapping[str, float]) -> Float[Tensor, " 10"]:
    """The likeliest shape whose limbs are that long: Gauss-Newton on four lengths, betas ~ N(0, 1).

    Args:
        lengths_m: by the far end of the bone: knee, ankle, elbow, wrist.
    """
    target = torch.tensor([lengths_m[far] for far in BONES], dtype=model.dtype)
    rows = [[SMPL_JOINTS.index(f"left_{end}") for end in bone] for bone in BONES.items()]

    def misfit(betas: Tensor) -> Tensor:
        joints = model.shape(betas).joints_rest
        bones = torch.stack([joints[far] - joints[near] for far, near in rows])
        return (bones.norm(dim=-1) - target) / LENGTH_SPREAD_M

    betas = torch.zeros(model.num_betas, dtype=model.dtype)
    for _ in range(STEPS):
        J = torch.autograd.functional.jacobian(misfit, betas)
        normal = J.mT @ J + torch.eye(len(betas), dtype=model.dtype)
        betas = betas - torch.linalg.solve(normal, J.mT @ misfit(betas) + betas)
    return betas
