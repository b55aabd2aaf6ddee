"""Sequences of frames: runs, the cheapest path through states, presentation times.

Presentation times of a video's frames: whether its rate is constant, and even moments in it. Phones
and screen recorders write frames when they have them. Everything that follows the keypoints works
at a constant rate, so a video of variable rate is read at even moments, each at a fractional frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int


def runs(flags: Bool[np.ndarray, " T"], least: int = 1, gap: int = 0) -> list[tuple[int, int]]:
    """First and last index of each run of True of at least `least` frames; runs that at most `gap`
    frames separate are one."""
    index = np.flatnonzero(flags)
    if not len(index):
        return []
    cuts = np.flatnonzero(np.diff(index) > gap + 1)
    begins, ends = index[np.r_[0, cuts + 1]], index[np.r_[cuts, len(index) - 1]]
    return [(int(a), int(b)) for a, b in zip(begins, ends, strict=True) if b - a + 1 >= least]


def index_at(
    values: Float[np.ndarray, " S"], wanted: Float[np.ndarray, " N"]
) -> Float[np.ndarray, " N"]:
    """Fractional indices at which values that never fall, NaN where unknown, are as wanted; NaN
    outside of them."""
    finite = np.flatnonzero(np.isfinite(values))
    if not len(finite):
        return np.full(len(wanted), np.nan)
    return np.asarray(np.interp(wanted, values[finite], finite, left=np.nan, right=np.nan))


def viterbi(
    first: Float[np.ndarray, " S"], steps: Float[np.ndarray, "T S S"]
) -> Int[np.ndarray, " _"]:
    """States (T + 1,) of least total cost.

    Args:
        first: cost of each state in the first frame.
        steps: of frame t + 1 in the second state after frame t in the first.
    """
    total, back = first, []
    for step in steps:
        costs = total[:, None] + step
        back.append(costs.argmin(0))
        total = costs.min(0)
    states = [int(total.argmin())]
    for pointer in reversed(back):
        states.append(int(pointer[states[-1]]))
    return np.array(states[::-1])


UNEVEN_FRAMES = 0.25  # off its place at a constant rate: more is a variable rate
SAME_RATE = 0.01  # a header's rate that is less wrong than this is the rate
TYPICAL = 0.1  # intervals within this share of the median are the typical ones
BRIDGED_S = 0.1  # a longer interval between two frames shows nothing of the time between them
BRIDGED_STEPS = 1.6  # or so many steps, where that is longer
NEAR_STEPS = 0.25  # as near as this to a frame, a moment is that frame


@dataclass(frozen=True)
class EvenMoments:
    """Moments of equal distance in a video of T frames.

    Attributes:
        fps: moments a second.
        time_s: (N,) presentation times.
        position: (N,) fractional frames.
    """

    fps: float
    time_s: Float[np.ndarray, " N"]
    position: Float[np.ndarray, " N"]

    @property
    def nearest(self) -> Int[np.ndarray, " N"]:
        """The frame nearest to each moment."""
        return np.rint(self.position).astype(np.int64)


def theil_sen_slope(frames: Int[np.ndarray, " N"], positions: Float[np.ndarray, " N"]) -> float:
    """Slope of positions over frames: the median over pairs that lie more than a quarter of the
    frames apart (Theil-Sen); 0 without any."""
    later = np.subtract.outer(frames, frames)
    risen = np.subtract.outer(positions, positions)
    apart = later > np.ptp(frames) / 4
    return float(np.median(risen[apart] / later[apart])) if apart.any() else 0.0


def typical_step_s(time_s: Float[np.ndarray, " T"]) -> float:
    """Mean of the intervals between frames that are about the median one, seconds."""
    steps = np.diff(time_s)
    median = float(np.sort(steps)[len(steps) // 2])
    return float(steps[np.abs(steps - median) <= TYPICAL * median].mean())


def is_constant_rate(time_s: Float[np.ndarray, " T"], fps: float) -> bool:
    """Whether frames at these increasing times are those of a constant rate of about ``fps``."""
    if len(time_s) < 2 or _unevenness(time_s, 1 / fps) <= UNEVEN_FRAMES:
        return True
    step = typical_step_s(time_s)
    return abs(step * fps - 1) <= SAME_RATE and _unevenness(time_s, step) <= UNEVEN_FRAMES


def _unevenness(time_s: Float[np.ndarray, " T"], step_s: float) -> float:
    """Largest distance of a frame from its place at a constant rate, frames."""
    lag = (time_s - time_s[0]) / step_s - np.arange(len(time_s))
    return float(np.abs(lag - np.median(lag)).max())


def even_moments(time_s: Float[np.ndarray, " T"]) -> EvenMoments:
    """Moments at the typical distance of frames, from the first frame to the last.

    Args:
        time_s: increasing, at least two.
    """
    step = typical_step_s(time_s)
    count = int((time_s[-1] - time_s[0]) / step + NEAR_STEPS) + 1
    moments_s = np.minimum(time_s[0] + step * np.arange(count), time_s[-1])
    return EvenMoments(1 / step, moments_s, np.interp(moments_s, time_s, np.arange(len(time_s))))


def points_at_moments(
    points: Float[np.ndarray, "T ..."], moments: EvenMoments, time_s: Float[np.ndarray, " T"]
) -> Float[np.ndarray, "N ..."]:
    """Detections between two frames by linear interpolation, coordinate by coordinate.

    NaN where the nearest frame has none, and in long intervals away from their ends: nothing was
    seen of what happened there. Where only the nearest frame has a detection, it is taken.
    """
    low = np.minimum(moments.position.astype(np.int64), len(points) - 2)
    share = (moments.position - low).reshape(-1, *[1] * (points.ndim - 1))
    nearest, other = (np.where(share < 0.5, points[low + i], points[low + 1 - i]) for i in (0, 1))
    weight = np.maximum(share, 1 - share)
    between = np.where(np.isfinite(other), weight * nearest + (1 - weight) * other, nearest)
    interval = time_s[low + 1] - time_s[low]
    bridged = interval <= max(BRIDGED_S, BRIDGED_STEPS / moments.fps)
    away = np.minimum(moments.time_s - time_s[low], time_s[low + 1] - moments.time_s)
    single = (away <= NEAR_STEPS / moments.fps).reshape(share.shape)
    between = np.where(bridged.reshape(share.shape), between, np.where(single, nearest, np.nan))
    return np.asarray(np.where(share * (1 - share) == 0, nearest, between))
