"""The mean motion of several performances, and each performance's deviation from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float

from imocap_core.rotations import log, mean
from imocap_core.technique.performances import AlignedPerformances, mean_over


@dataclass(frozen=True, eq=False)
class MeanMotion:
    """The mean of M performances at N moments, and the deviations from it.

    Attributes:
        R_local: chordal mean of every joint's rotation.
        joints: mean position from the pelvis, metres.
        turns: rotation vectors from the mean to each performance, in the joint's own axes, radians;
            0 where a performance does not show the moment.
        shifts: from the mean position to each performance's, metres; 0 likewise.
    """

    R_local: Float[np.ndarray, "N J 3 3"]
    joints: Float[np.ndarray, "N J 3"]
    turns: Float[np.ndarray, "M N J 3"]
    shifts: Float[np.ndarray, "M N J 3"]


def mean_motion(performances: AlignedPerformances) -> MeanMotion:
    """Mean over the performances that show a moment."""
    R = torch.as_tensor(performances.R_local)
    weight = performances.inside.astype(np.float64)
    mean_R = mean(R, torch.as_tensor(weight)[..., None])
    joints = mean_over(performances.joints, weight)
    shown = weight[..., None, None]
    turns = log(mean_R.transpose(-1, -2) @ R).numpy() * shown
    return MeanMotion(mean_R.numpy(), joints, turns, (performances.joints - joints) * shown)


def spread(
    deviations: Float[np.ndarray, "M N J 3"], inside: Bool[np.ndarray, "M N"]
) -> Float[np.ndarray, "N J"]:
    """Standard deviation over the performances, from their deviations from the mean.

    With n - 1 degrees of freedom; NaN where fewer than two performances show the moment.
    """
    squares = (deviations**2).sum(-1) * inside[..., None]
    free = inside.sum(0) - 1.0
    safe = np.where(free > 0, free, 1.0)[:, None]
    return np.where(free[:, None] > 0, np.sqrt(squares.sum(0) / safe), np.nan)


def over_moments(spread_: Float[np.ndarray, "N J"]) -> Float[np.ndarray, " J"]:
    """Root mean square of a spread over the moments; NaN moments are left out."""
    valid = np.isfinite(spread_)
    total = np.where(valid, spread_, 0.0) ** 2
    count = valid.sum(0)
    return np.where(count > 0, np.sqrt(total.sum(0) / np.maximum(count, 1)), np.nan)
