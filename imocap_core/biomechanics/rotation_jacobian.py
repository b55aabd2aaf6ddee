"""How the rotations of the anatomical joints follow increments of the body model's.

A segment is turned by one of SMPL's joints, and those between it and its proximal neighbour carry
it along. The forearm is turned by the elbow and the twist of the wrist (`segments`).
"""

from __future__ import annotations

import re

import numpy as np
from jaxtyping import Float

from imocap_core.biomechanics.joint_angles import (
    ANATOMICAL_JOINTS,
    JointDefinition,
    definition_of,
)
from imocap_core.biomechanics.segments import (
    LIMBS,
    MIRROR,
    TRUNK,
    forearm_axis,
    joint_index,
    segment_rest_axes,
    twist_about,
    twist_gradient,
)
from imocap_core.conventions import SMPL_JOINTS, SMPL_PARENTS, Side

SEGMENTS = {**TRUNK, **LIMBS}
OTHER = {"left_": "right_", "right_": "left_"}
TWINS = [  # of each joint its counterpart on the other side
    ANATOMICAL_JOINTS.index(re.sub("left_|right_", lambda side: OTHER[side[0]], joint))
    for joint in ANATOMICAL_JOINTS
]
PAIRED_FROM = 3  # pelvis, trunk and neck have no twin


def rotation_jacobian(
    R_local: Float[np.ndarray, "T 24 3 3"], rest_m: Float[np.ndarray, "24 3"]
) -> Float[np.ndarray, "T 15 3 72"]:
    """Derivatives of the rotations of `ANATOMICAL_JOINTS`, as vectors in the axes of the distal
    segment (right-handed on both sides), by increments R <- R exp(delta) of SMPL's joints.

    Args:
        R_local: rotations of SMPL's joints against their parents, the first in any axes.
        rest_m: the joints of the rest pose, metres.
    """
    rows = np.zeros((len(R_local), len(ANATOMICAL_JOINTS), 3, len(SMPL_JOINTS), 3))
    for k, joint in enumerate(ANATOMICAL_JOINTS):
        side, of = definition_of(joint)
        flip = MIRROR if side == "left" else np.eye(3)
        axes = segment_rest_axes(SEGMENTS[of.distal], rest_m @ flip, side)
        turned = axes.T @ flip * np.linalg.det(flip)
        rows[:, k] = np.einsum("xy,tyjz->txjz", turned, _by_increments(R_local, rest_m, side, of))
    return rows.reshape(*rows.shape[:3], -1)


def mirrored_rotation_covariance(
    covariance: Float[np.ndarray, "T 15 3 3"],
) -> Float[np.ndarray, "T 15 3 3"]:
    """Covariances of the joints' rotations in a mirror: of limbs their twins', whose axes are
    mirrored already; those of the middle turn the other way about X and Y."""
    swapped = np.array(covariance[:, TWINS])
    turn = np.array([-1.0, -1.0, 1.0])
    swapped[:, :PAIRED_FROM] *= turn[:, None] * turn
    return swapped


def _by_increments(
    R_local: Float[np.ndarray, "T 24 3 3"],
    rest_m: Float[np.ndarray, "24 3"],
    side: Side,
    of: JointDefinition,
) -> Float[np.ndarray, "T 3 24 3"]:
    """The derivatives of one joint, in the axes of the distal segment's joint of SMPL."""
    rows = np.zeros((len(R_local), 3, len(SMPL_JOINTS), 3))
    wrist, axis = joint_index("wrist", side), forearm_axis(rest_m, side)
    if of.proximal == "forearm":  # R = twist^T R_wrist
        carried = np.swapaxes(R_local[:, wrist], 1, 2) @ twist_about(R_local[:, wrist], axis)
        twisted = np.einsum("tx,ty->txy", carried @ axis, twist_gradient(R_local[:, wrist], axis))
        rows[:, :, wrist] = np.eye(3) - twisted
        return rows
    after = np.tile(np.eye(3), (len(R_local), 1, 1))  # what turns the segment after a joint
    if of.distal == "forearm":  # R = R_elbow twist
        after = twist_about(R_local[:, wrist], axis)
        rows[:, :, wrist] = axis[:, None] * twist_gradient(R_local[:, wrist], axis)[:, None]
    for joint in _chain(of, side):
        rows[:, :, joint] = np.swapaxes(after, 1, 2)
        after = R_local[:, joint] @ after
    return rows


def _chain(of: JointDefinition, side: Side) -> list[int]:
    """SMPL's joints that turn the distal segment against the proximal one, the last first."""
    joint = joint_index(SEGMENTS[of.distal].joint, side)
    end = -1 if of.proximal is None else joint_index(SEGMENTS[of.proximal].joint, side)
    chain = []
    while joint != end:
        chain.append(joint)
        joint = SMPL_PARENTS[joint]
    return chain
