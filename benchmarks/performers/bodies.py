"""Captured joints of a skeleton as those of another body: the same rotations, other bones."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from jaxtyping import Float

from benchmarks.synthetic.captured import hip_middle
from imocap_core.body.model import Model
from imocap_core.conventions import EVAL_14, SMPL_JOINTS

SIDES = ("left", "right")
LIMB_BONES = {"knee": "hip", "ankle": "knee", "elbow": "shoulder", "wrist": "elbow"}
PARENT_OF = {f"{s}_{far}": f"{s}_{near}" for s in SIDES for far, near in LIMB_BONES.items()}
PARENT_OF |= {"left_shoulder": "neck", "right_shoulder": "neck", "head": "neck"}
LIMBS = tuple(f"{s}_{end}" for end in LIMB_BONES for s in SIDES)
BODY_PARENT = {**PARENT_OF, "neck": "pelvis", "left_hip": "pelvis", "right_hip": "pelvis"}


def bone_lengths_m(model: Model, betas: Float[np.ndarray, "10"]) -> dict[str, float]:
    """Lengths of a shape's bones by their far ends; the trunk's is from pelvis to neck."""
    rest = model.shape(torch.as_tensor(betas)).joints_rest.numpy()
    place = {name: rest[SMPL_JOINTS.index(name)] for name in SMPL_JOINTS}
    return {
        far: float(np.linalg.norm(place[far] - place[near])) for far, near in BODY_PARENT.items()
    }


def limb_lengths_m(joints_m: Float[np.ndarray, "T 14 3"]) -> dict[str, float]:
    """Median lengths of captured limbs by their far ends."""
    row = EVAL_14.index
    return {
        far: float(
            np.median(
                np.linalg.norm(joints_m[:, row(far)] - joints_m[:, row(PARENT_OF[far])], axis=-1)
            )
        )
        for far in LIMBS
    }


def with_bones(
    joints_m: Float[np.ndarray, "T 14 3"], ratio: Mapping[str, float]
) -> Float[np.ndarray, "T 14 3"]:
    """Joints whose bones are longer by a ratio, by their far ends, in the same directions.

    The path, about the first frame's place on the ground, is as much longer as the legs, so that
    feet in contact stay in contact.
    """
    row = EVAL_14.index
    legs = float(np.mean([ratio[f"{s}_{end}"] for s in SIDES for end in ("knee", "ankle")]))
    middle = hip_middle(joints_m)
    origin = middle[:1] * np.array([1.0, 1.0, 0.0])
    out = np.empty_like(joints_m)
    placed = origin + legs * (middle - origin)
    for name in ("left_hip", "right_hip", "neck"):
        out[:, row(name)] = placed + ratio[name] * (joints_m[:, row(name)] - middle)
    waiting = dict(PARENT_OF)
    done = {"left_hip", "right_hip", "neck"}
    while waiting:
        far = next(name for name, near in waiting.items() if near in done)
        near = waiting.pop(far)
        bone = joints_m[:, row(far)] - joints_m[:, row(near)]
        out[:, row(far)] = out[:, row(near)] + ratio[far] * bone
        done.add(far)
    return out
