"""Forward kinematics of a joint tree, all joints of one depth at a time."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import torch
from jaxtyping import Float
from torch import Tensor


@lru_cache(maxsize=64)
def tree_levels(parents: tuple[int, ...]) -> tuple[tuple[int, ...], ...]:
    """Joints grouped by their depth below the root; the first group is the root."""
    depth = [0] * len(parents)
    for joint, parent in enumerate(parents[1:], start=1):
        depth[joint] = depth[parent] + 1
    return tuple(
        tuple(j for j, d in enumerate(depth) if d == level) for level in range(max(depth) + 1)
    )


def check_tree(parents: Sequence[int]) -> None:
    """Raise ValueError unless joint 0 is the only root and every parent precedes its child."""
    if not parents or parents[0] != -1:
        raise ValueError("parents: joint 0 must be the root, with parent -1")
    for joint, parent in enumerate(parents[1:], start=1):
        if not 0 <= parent < joint:
            raise ValueError(
                f"parents: joint {joint} has parent {parent}, expected 0 to {joint - 1}"
            )


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
    levels = tree_levels(parents)
    if len(levels) == 1:
        return R_local
    blocks = [R_local[..., :1, :, :]]
    place = {0: 0}  # joint -> its position within the level it belongs to
    for level in levels[1:]:
        above = blocks[-1][..., [place[parents[j]] for j in level], :, :]
        blocks.append(above @ R_local[..., list(level), :, :])
        place = {j: i for i, j in enumerate(level)}
    order = [j for level in levels for j in level]
    inverse = [order.index(j) for j in range(len(parents))]
    return torch.cat(blocks, dim=-3)[..., inverse, :, :]


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
