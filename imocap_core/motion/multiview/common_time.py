"""Motions brought from their own frames to one time axis that all videos share.

The axis is the synchronisation's phase (imocap_core/sync/phase.py), seconds of the reference. On it
one grid of even steps spans all videos; a video is looked up where its phase says. Before its first
and after its last frame it holds still, and `inside` says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from imocap_core.motion.multiview.timeline import sample_rotations
from imocap_core.rotations import exp, log, unwrap

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Moments:
    """Where a video is looked at.

    at: (N,) fractional index of its used frames. inside: (N,) False where the video shows nothing
    of that moment and its nearest end stands in.
    """

    at: Array
    inside: NDArray[np.bool_]


def common_grid(phases_s: Sequence[Array], fps: float) -> Array:
    """Even steps (N,), 1 / fps apart, over all that any video shows, seconds of the reference.

    The grid holds phase 0 whenever that lies within. Frames without a phase are NaN and count for
    nothing. ValueError when no video has any, or `fps` is not positive.
    """
    if not fps > 0:
        raise ValueError(f"fps: expected > 0, got {fps}")
    known = [phase[np.isfinite(phase)] for phase in phases_s]
    if not any(len(phase) for phase in known):
        raise ValueError("phases_s: expected a video with a place on the axis, got none")
    every = np.concatenate(known)
    first, last = np.ceil(every.min() * fps - 1e-6), np.floor(every.max() * fps + 1e-6)
    return np.asarray((np.arange(first, last + 1) + 0.0) / fps)


def moments_of(phase_s: Array, grid_s: Array) -> Moments:
    """Where the moments `grid_s` (N,) lie in a video of phases (T,), which never fall; NaN unknown.

    Where a video rests on one phase for several frames, the step over it is taken at once.
    """
    known = np.flatnonzero(np.isfinite(phase_s))
    if not len(known):
        raise ValueError("phase_s: expected at least one frame with a phase, got none")
    rising = phase_s[known]
    if (np.diff(rising) < 0).any():
        raise ValueError("phase_s: expected phases that never fall, got some that do")
    at = np.interp(grid_s, rising + 1e-9 * np.arange(len(known)), known.astype(np.float64))
    slack = 1e-6
    return Moments(at, (grid_s >= rising[0] - slack) & (grid_s <= rising[-1] + slack))


def pose_at(theta: Array, at: Array) -> Array:
    """Axis-angle poses (T, 3 J), radians, at fractional frames (N,): every joint geodesically."""
    local = exp(torch.as_tensor(theta).reshape(len(theta), -1, 3))
    return unwrap(log(sample_rotations(local, at))).reshape(len(at), -1).numpy()


def values_at(values: Array, at: Array) -> Array:
    """Values (T, ...) at fractional frames (N,), linearly between two."""
    low = np.minimum(np.floor(at).astype(np.int64), max(len(values) - 2, 0))
    high = np.minimum(low + 1, len(values) - 1)
    share = (at - low).reshape(-1, *[1] * (values.ndim - 1))
    return np.asarray((1 - share) * values[low] + share * values[high])
