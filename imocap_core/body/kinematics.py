"""Forward kinematics of a joint tree, and its centre of mass.

Centre of mass of a body from its joints. Shares of the body's mass and the place of each segment's
centre along it: de Leva, Adjustments to Zatsiorsky-Seluyanov's segment inertia parameters, J.
Biomechanics 29 (1996), men. The numbers have not been compared with the printed edition; a
centimetre or two is all that balance asks for.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.conventions import SMPL_JOINTS
from imocap_core.rotations import for_processor
from imocap_core.workers import compiled

Landmark = tuple[tuple[int, float], ...]  # (vertex, weight) pairs whose weights sum to 1


def ancestors(parents: Sequence[int]) -> Float[Tensor, "J J"]:
    """Ancestor matrix A, float64: A[j, a] = 1 where a is j itself or an ancestor of j, else 0."""
    table = torch.eye(len(parents), dtype=torch.float64)
    for joint, parent in enumerate(parents[1:], start=1):
        table[joint] += table[parent]
    return table


def world_rotations(
    R_local: Float[Tensor, "... J 3 3"], parents: tuple[int, ...]
) -> Float[Tensor, "... J 3 3"]:
    """World rotations of the joints: local rotations composed down the tree."""
    if for_processor(R_local):
        rows = R_local.reshape(-1, len(parents), 3, 3).contiguous()
        R_world = torch.empty_like(rows)
        _compose(rows.numpy(), R_world.numpy(), np.array(parents))
        return R_world.view(R_local.shape)
    world = [R_local[..., 0, :, :]]
    for joint, parent in enumerate(parents[1:], start=1):
        world.append(world[parent] @ R_local[..., joint, :, :])
    return torch.stack(world, dim=-3)


@compiled
def _compose(R_local, R_world, parents):  # type: ignore[no-untyped-def]
    """`world_rotations` of T poses (T, J, 3, 3), in place."""
    for t in range(len(R_local)):
        R_world[t, 0] = R_local[t, 0]
        for j in range(1, len(parents)):
            above, local, world = R_world[t, parents[j]], R_local[t, j], R_world[t, j]
            for i in range(3):
                x, y, z = above[i]
                for k in range(3):
                    world[i, k] = x * local[0, k] + y * local[1, k] + z * local[2, k]


def joint_positions(
    R_world: Float[Tensor, "... J 3 3"],
    joints_rest: Float[Tensor, "... J 3"],
    transl: Float[Tensor, "... 3"],
    parents: tuple[int, ...],
) -> Float[Tensor, "... J 3"]:
    """World positions of the joints, metres: each is its parent's plus the rotated rest-pose bone.

    The pelvis is at ``joints_rest[0] + transl``. Leading axes broadcast.
    """
    if len(parents) == 1:
        return joints_rest + transl[..., None, :]
    above = list(parents[1:])
    bones = joints_rest[..., 1:, :] - joints_rest[..., above, :]
    bones_world = (R_world[..., above, :, :] @ bones[..., None])[..., 0]
    chain = ancestors(parents)[:, 1:].to(bones_world)
    root = joints_rest[..., :1, :] + transl[..., None, :]
    return root + chain @ bones_world


# proximal joint, distal joint, share of the mass, centre from the proximal to the distal joint
MIDDLE_SEGMENTS = (
    ("neck", "head", 0.0694, 1.2),
    ("pelvis", "spine1", 0.1117, 0.3),
    ("spine1", "spine3", 0.1633, 0.5),
    ("spine3", "neck", 0.1596, 0.5),
)
LIMB_SEGMENTS = (
    ("shoulder", "elbow", 0.0271, 0.58),
    ("elbow", "wrist", 0.0162, 0.46),
    ("wrist", "hand", 0.0061, 0.5),
    ("hip", "knee", 0.1416, 0.41),
    ("knee", "ankle", 0.0433, 0.45),
    ("ankle", "foot", 0.0137, 0.5),
)


def _joint_shares() -> Float[np.ndarray, "24"]:
    segments = list(MIDDLE_SEGMENTS)
    for side in ("left", "right"):
        segments += [
            (f"{side}_{a}", f"{side}_{b}", share, where) for a, b, share, where in LIMB_SEGMENTS
        ]
    shares = np.zeros(len(SMPL_JOINTS))
    for proximal, distal, share, where in segments:
        shares[SMPL_JOINTS.index(proximal)] += share * (1 - where)
        shares[SMPL_JOINTS.index(distal)] += share * where
    return np.asarray(shares / shares.sum())


JOINT_MASS_SHARES = _joint_shares()
"""(24,) weights of SMPL's joints whose weighted mean is the body's centre of mass."""


def centre_of_mass(joints: Float[np.ndarray, "*T 24 3"]) -> Float[np.ndarray, "*T 3"]:
    """Centre of mass, in the joints' axes and unit."""
    return np.einsum("j,...jc->...c", JOINT_MASS_SHARES, joints)
