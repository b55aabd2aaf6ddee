"""The motion that performances share, and how far each is from it at every moment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from imocap_core.rotations import log, mean
from imocap_core.technique.instances import Instances, mean_over

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MeanMotion:
    """The mean of M performances at N moments, and the deviations from it.

    Attributes:
        R_local (N, J, 3, 3): chordal mean of every joint's rotation.
        joints (N, J, 3): mean place from the pelvis, metres.
        turns (M, N, J, 3): rotation vectors from the mean to each performance, in the joint's own
            axes, radians; 0 where a performance does not show the moment.
        shifts (M, N, J, 3): from the mean place to each performance's, metres; likewise.
    """

    R_local: Array
    joints: Array
    turns: Array
    shifts: Array


def mean_motion(found: Instances) -> MeanMotion:
    """Mean over the performances that show a moment."""
    R = torch.as_tensor(found.R_local)
    weight = found.inside.astype(np.float64)
    middle = mean(R, torch.as_tensor(weight)[..., None])
    joints = mean_over(found.joints, weight)
    seen = weight[..., None, None]
    turns = log(middle.transpose(-1, -2) @ R).numpy() * seen
    return MeanMotion(middle.numpy(), joints, turns, (found.joints - joints) * seen)


def spread(deviations: Array, inside: NDArray[np.bool_]) -> Array:
    """(N, J) standard deviation over the performances of deviations (M, N, J, 3) from their mean.

    By the n - 1 that the mean leaves; NaN where fewer than two performances show the moment.
    """
    squares = (deviations**2).sum(-1) * inside[..., None]
    free = inside.sum(0) - 1.0
    safe = np.where(free > 0, free, 1.0)[:, None]
    return np.where(free[:, None] > 0, np.sqrt(squares.sum(0) / safe), np.nan)


def over_moments(spread_: Array) -> Array:
    """(J,) root mean square over the moments of a spread (N, J); NaN moments count for nothing."""
    known = np.isfinite(spread_)
    total = np.where(known, spread_, 0.0) ** 2
    count = known.sum(0)
    return np.where(count > 0, np.sqrt(total.sum(0) / np.maximum(count, 1)), np.nan)
