"""How the rigid segments of a captured skeleton turn, relative to its neutral stance."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from benchmarks.synthetic.captured_stance import CapturedSkeleton, NeutralStance


def rotations_from_stance(
    skeleton: CapturedSkeleton, stance: NeutralStance, xyz: Float[np.ndarray, "T J 3"]
) -> Float[np.ndarray, "3 T 3 3"]:
    """Rotations of pelvis, chest and head from the neutral stance's body axes to the world."""
    return np.stack(
        [
            rotations_between(stance.vectors[segment], skeleton.rigid_points(xyz, segment)[0])
            for segment in (skeleton.pelvis, skeleton.chest, skeleton.head)
        ]
    )


def trunk_bone_rotations(
    skeleton: CapturedSkeleton, stance: NeutralStance, xyz: Float[np.ndarray, "T J 3"]
) -> Float[np.ndarray, "3 T 3 3"]:
    """Rotations of neck, left and right collar: the chest's, then the shortest to the bone.

    Two joints do not tell how a bone turns about itself.
    """
    chest = rotations_from_stance(skeleton, stance, xyz)[1]
    turned = []
    for name, template in stance.trunk_bones.items():
        in_chest = np.einsum("tji,tj->ti", chest, skeleton.trunk_bone(xyz, name))
        turned.append(chest @ shortest_rotations(template, in_chest))
    return np.stack(turned)


def shortest_rotations(
    start: Float[np.ndarray, "3"], end: Float[np.ndarray, "T 3"]
) -> Float[np.ndarray, "T 3 3"]:
    """The shortest rotation from one unit vector to others that are not opposite to it.

    1 + [v] + [v]^2 / (1 + cos), with v the cross product (Rodrigues).
    """
    cross = np.cross(start, end)
    x, y, z = cross.T
    zero = np.zeros_like(x)
    skew = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(-1, 3, 3)
    rotation: np.ndarray = np.eye(3) + skew + skew @ skew / (1.0 + end @ start)[:, None, None]
    return rotation


def rotations_between(
    template: Float[np.ndarray, "C 3"], observed: Float[np.ndarray, "T C 3"]
) -> Float[np.ndarray, "T 3 3"]:
    """The rotations that turn a template's vectors best into the observed ones (Kabsch 1976)."""
    U, _, Vt = np.linalg.svd(np.einsum("tci,cj->tij", observed, template))
    U[:, :, 2] *= np.sign(np.linalg.det(U @ Vt))[:, None]
    rotation: np.ndarray = U @ Vt
    return rotation
