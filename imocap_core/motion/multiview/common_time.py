"""Motions resampled from their own frames to the time axis that all videos share.

The axis is the synchronisation's phase (imocap_core/sync/phase.py), seconds of the reference. On it
one grid of even steps spans all videos; a video is sampled at the frames of these phases. Before
its first and after its last frame the nearest end is repeated, and `inside` is False.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float

from imocap_core.motion.multiview.timeline import sample_rotations
from imocap_core.rotations import exp, log, unwrap


@dataclass(frozen=True)
class FramePositions:
    """Where N moments lie among a video's used frames.

    Attributes:
        position: (N,) fractional index of its used frames.
        inside: (N,) False before its first and after its last frame, where its nearest end is used.
    """

    position: Float[np.ndarray, " N"]
    inside: Bool[np.ndarray, " N"]


def common_grid(phases_s: Sequence[Float[np.ndarray, " _"]], fps: float) -> Float[np.ndarray, " N"]:
    """Even steps, 1 / fps apart, over the phases of all videos, seconds of the reference.

    The grid contains phase 0 whenever that lies within. NaN phases are ignored.

    Raises:
        ValueError: no video has a phase, or ``fps`` is not positive.
    """
    if not fps > 0:
        raise ValueError(f"fps: expected > 0, got {fps}")
    finite = [phase[np.isfinite(phase)] for phase in phases_s]
    if not any(len(phase) for phase in finite):
        raise ValueError("phases_s: expected a video with a place on the axis, got none")
    every = np.concatenate(finite)
    first, last = np.ceil(every.min() * fps - 1e-6), np.floor(every.max() * fps + 1e-6)
    return np.asarray((np.arange(first, last + 1) + 0.0) / fps)


def frame_positions(
    phase_s: Float[np.ndarray, " T"], grid_s: Float[np.ndarray, " N"]
) -> FramePositions:
    """Positions of the moments ``grid_s`` in a video of phases that never fall; NaN is unknown.

    Several frames of equal phase are stepped over at once.

    Raises:
        ValueError: no frame has a phase, or phases fall.
    """
    finite = np.flatnonzero(np.isfinite(phase_s))
    if not len(finite):
        raise ValueError("phase_s: expected at least one frame with a phase, got none")
    rising = phase_s[finite]
    if (np.diff(rising) < 0).any():
        raise ValueError("phase_s: expected phases that never fall, got some that do")
    strictly = rising + 1e-9 * np.arange(len(finite))
    position = np.interp(grid_s, strictly, finite.astype(np.float64))
    slack = 1e-6
    inside = (grid_s >= rising[0] - slack) & (grid_s <= rising[-1] + slack)
    return FramePositions(position, inside)


def pose_at(
    theta: Float[np.ndarray, "T D"], position: Float[np.ndarray, " N"]
) -> Float[np.ndarray, "N D"]:
    """Axis-angle poses (D = 3 J, radians) at fractional frames: every joint geodesically."""
    local = exp(torch.as_tensor(theta).reshape(len(theta), -1, 3))
    return unwrap(log(sample_rotations(local, position))).reshape(len(position), -1).numpy()


def values_at(
    values: Float[np.ndarray, "T ..."], position: Float[np.ndarray, " N"]
) -> Float[np.ndarray, "N ..."]:
    """Values at fractional frames, linearly between two."""
    low = np.minimum(np.floor(position).astype(np.int64), max(len(values) - 2, 0))
    high = np.minimum(low + 1, len(values) - 1)
    share = (position - low).reshape(-1, *[1] * (values.ndim - 1))
    return np.asarray((1 - share) * values[low] + share * values[high])
