"""Mean and standard deviation of an angle over several performances of an action."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

TURN_DEG = 360.0


@dataclass(frozen=True, eq=False)
class MeanCurve:
    """An angle over N moments of the action.

    mean_deg, sd_deg (N,): over the performances that show the moment (n of them); NaN where none
    does, and the standard deviation where fewer than two do.
    """

    mean_deg: Float[np.ndarray, " N"]
    sd_deg: Float[np.ndarray, " N"]
    n: Int[np.ndarray, " N"]


def mean_curve(
    curves_deg: Sequence[Float[np.ndarray, " N"]], inside: Sequence[Bool[np.ndarray, " N"]]
) -> MeanCurve:
    """Mean of M curves at N common moments; each is moved by whole turns to lie near the first.

    inside: whether a performance shows the moment.
    """
    values = np.stack([np.where(i, c, np.nan) for c, i in zip(curves_deg, inside, strict=True)])
    for k in range(1, len(values)):
        values[k] = near(values[k], values[0])
    there = np.isfinite(values)
    n = there.sum(axis=0)
    total = np.where(there, values, 0.0).sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(n > 0, total / n, np.nan)
        squares = np.where(there, (values - mean) ** 2, 0.0).sum(axis=0)
        sd = np.where(n > 1, np.sqrt(squares / (n - 1)), np.nan)
    return MeanCurve(mean, sd, n)


def near(
    curve_deg: Float[np.ndarray, " N"], reference_deg: Float[np.ndarray, " N"]
) -> Float[np.ndarray, " N"]:
    """A curve moved by whole turns to lie near a reference."""
    away = curve_deg - reference_deg
    if not np.isfinite(away).any():
        return curve_deg
    return np.asarray(curve_deg - TURN_DEG * np.round(np.nanmedian(away) / TURN_DEG))


def without_steps(curve: MeanCurve) -> Float[np.ndarray, " N"]:
    """The mean, NaN where a performance begins or ends: its step there is no movement."""
    changes = np.diff(curve.n, prepend=curve.n[:1]) != 0
    return np.where(changes, np.nan, curve.mean_deg)
