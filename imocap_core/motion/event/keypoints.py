"""Keypoints of videos of one event, at the moments of the reference's frames.

A frame n of the reference shows what frame ``offset + rate * n`` of another video shows. Keypoints
there are those of a local quadratic regression, whose slope is the derivative by the offset:
between two frames interpolation would average their noise, and prefer half frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

KERNEL_FRAMES, REACH = 1.5, 4  # standard deviation of the regression's weights, and their end
RIDGE = 1e-9


@dataclass(frozen=True)
class EventVideo:
    """One video's keypoints.

    Attributes:
        xy_px: (T, J, 2), NaN where missing.
        weight: (T, J) inverse variance of a detection, 1/px^2, 0 where missing.
        size_px: (T,) the person's size.
    """

    xy_px: Float[np.ndarray, "T J 2"]
    weight: Float[np.ndarray, "T J"]
    size_px: Float[np.ndarray, " T"]


@dataclass(frozen=True)
class KeypointSamples:
    """Keypoints of M videos at N moments; 0 where a video has none.

    Attributes:
        xy_px: (N, J, M, 2); velocity_px: (N, J, M, 2) a frame of the video.
        weight: (N, J, M) 1/px^2; size_px: (N, M).
    """

    xy_px: Float[np.ndarray, "N J M 2"]
    velocity_px: Float[np.ndarray, "N J M 2"]
    weight: Float[np.ndarray, "N J M"]
    size_px: Float[np.ndarray, "N M"]

    def part(self, moments: slice) -> KeypointSamples:
        """Some of the moments."""
        values = (self.xy_px, self.velocity_px, self.weight, self.size_px)
        return KeypointSamples(*(value[moments] for value in values))


def sample(
    videos: Sequence[EventVideo],
    offset: Float[np.ndarray, " M"],
    rate: Float[np.ndarray, " M"],
    moments: Float[np.ndarray, " N"],
) -> KeypointSamples:
    """All videos at fractional frames ``offset + rate * moments``.

    A keypoint needs three frames around the moment, one of them within a frame; outside a clip
    there is none.
    """
    columns = [_one(video, offset[v] + rate[v] * moments) for v, video in enumerate(videos)]
    xy, velocity, weight, size = zip(*columns, strict=True)
    return KeypointSamples(
        np.stack(xy, 2), np.stack(velocity, 2), np.stack(weight, 2), np.stack(size, 1)
    )


def _one(
    video: EventVideo, position: Float[np.ndarray, " N"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Local quadratic regression: values (N, J, 2), velocities, weights (N, J), sizes (N,)."""
    last = len(video.xy_px) - 1
    inside = (position >= -0.5) & (position <= last + 0.5)
    centre = np.clip(position, 0, last)
    frames = np.round(centre).astype(int)[:, None] + np.arange(-REACH, REACH + 1)
    shown = (frames >= 0) & (frames <= last)
    frames = np.clip(frames, 0, last)
    away = frames - centre[:, None]
    kernel = np.where(shown, np.exp(-0.5 * (away / KERNEL_FRAMES) ** 2), 0.0)
    missing = ~np.isfinite(video.xy_px).all(-1)
    given = np.where(missing, 0.0, video.weight)[frames]  # (N, W, J)
    w = kernel[..., None] * (given > 0)
    powers = away[..., None] ** np.arange(5)
    sums = np.einsum("nwj,nwp->njp", w, powers)
    matrix = sums[..., np.add.outer(np.arange(3), np.arange(3))]
    target = np.einsum("nwj,nwp,nwjc->njpc", w, powers[..., :3], np.nan_to_num(video.xy_px)[frames])
    near = ((given > 0) & (np.abs(away) <= 1)[..., None]).any(1)
    usable = near & ((w > 0).sum(1) >= 3) & inside[:, None]
    matrix[~usable] = np.eye(3)
    solved = np.linalg.solve(matrix + RIDGE * np.eye(3), target)
    mean = np.einsum("nwj,nwj->nj", kernel[..., None] * np.ones_like(given), given)
    weight = np.where(usable, mean / np.maximum(sums[..., 0], 1e-12), 0.0)
    size = np.interp(centre, np.arange(last + 1), video.size_px)
    none = ~usable[..., None]
    return np.where(none, 0.0, solved[:, :, 0]), np.where(none, 0.0, solved[:, :, 1]), weight, size
