"""Variation: the distribution of an action's motion over its performances."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from imocap_core.biomechanics.joint_angles import MeanCurve
from imocap_core.motion.multiview.modes import Modes
from imocap_core.rotations import exp


@dataclass(frozen=True, eq=False)
class Variation:
    """The distribution of an action's motion over its performances.

    Attributes:
        ids: of the M performances; phase_s: (N,) moments, seconds of the reference.
        joint_names: J of SMPL's, the pelvis first.
        R_local: (N, J, 3, 3) the mean motion, every joint against its parent, y up, facing +z.
        joints: (N, J, 3) its places from the pelvis, metres.
        modes: those that predict held-out performances; there may be none.
        held_out: errors of held-out performances by 0, 1, 2, ... modes (`held_out_errors`).
        angles: mean and standard deviation over performances, by name.
    """

    ids: tuple[str, ...]
    phase_s: Float[np.ndarray, " N"]
    joint_names: tuple[str, ...]
    R_local: Float[np.ndarray, "N J 3 3"]
    joints: Float[np.ndarray, "N J 3"]
    modes: Modes
    held_out: Float[np.ndarray, " K1"]
    angles: Mapping[str, MeanCurve]

    def __repr__(self) -> str:
        return f"<Variation of {len(self.ids)} performances: {len(self.modes.share)} modes>"

    def at(self, scores: Float[np.ndarray, " K"]) -> Float[np.ndarray, "N J 3 3"]:
        """Rotations of the motion at some scores, in standard deviations of each mode.

        ValueError unless there is a number a mode.
        """
        given = np.asarray(scores, dtype=np.float64)
        if given.shape != self.modes.share.shape:
            raise ValueError(f"scores: expected {len(self.modes.share)} numbers, got {given.shape}")
        turned = exp(torch.as_tensor(np.einsum("k,knjx->njx", given, self.modes.turns)))
        return np.asarray(self.R_local @ turned.numpy())

    def draw(self, rng: np.random.Generator) -> Float[np.ndarray, "N J 3 3"]:
        """Rotations of a performance as there might be another: its modes at random."""
        return self.at(rng.normal(size=len(self.modes.share)))
