"""All videos' motions at the reference's frames."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.kinematics import Body
from imocap_core.motion.multiview.timeline import Timeline, sample, sample_rotations
from imocap_core.motion.state import MotionState


@dataclass(frozen=True)
class AlignedMotions:
    """M motions at the N frames of the reference, in their own cameras' axes or in the world's.

    Attributes:
        R_local: (M, N, 24, 3, 3); root: (M, N, 3) metres, the root joint;
        weight: (M, N) trust in the match, 0 where there is none.
    """

    R_local: Float[Tensor, "M N 24 3 3"]
    root: Float[Tensor, "M N 3"]
    weight: Float[Tensor, "M N"]


def root_positions(body: Body, state: MotionState) -> Float[Tensor, "B T 3"]:
    """The root joint, metres: SMPL's translation plus the resting root."""
    rest: Tensor = body.model.shape(state.betas).joints_rest[:, 0]
    return state.trans + rest[:, None]


def align(body: Body, state: MotionState, timeline: Timeline) -> AlignedMotions:
    """Sample every motion at the reference's frames."""
    root = root_positions(body, state)
    R, p = [], []
    for v, position in enumerate(timeline.from_reference):
        length = int(state.valid[v].sum())
        R.append(sample_rotations(state.R_local[v, :length], position))
        p.append(sample(root[v, :length], position))
    weight = torch.as_tensor(timeline.confidence).to(root)
    return AlignedMotions(torch.stack(R), torch.stack(p), weight)
