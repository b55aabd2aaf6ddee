"""Performers of rendered videos: a body with a captured performer's limbs, moving as captured.

The body's joints are the ground truth of the rendered videos; they differ from the captured ones
because joint centres of two skeletons never coincide (`retargeting`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from benchmarks.synthetic.captured_stance import CapturedSkeleton, NeutralStance
from benchmarks.synthetic.retargeting import fit_to_trunk_and_joints, trunk_and_joints
from imocap_core.body.model import Model
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.state import Body

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
