"""What one video contributes to a fit, and many videos as one padded batch."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from imocap_core.motion.terms.view import View

Array = NDArray[np.float64]
HAMPEL_WINDOW = 3  # frames on each side
HAMPEL_SHARE = 0.25  # of the person's size: a jump away from the median is a wrong detection


@dataclass(frozen=True)
class Observation:
    """One video's keypoints in its first frame's image.

    Attributes:
        xy_px: (T, K, 2), NaN where missing; confidence: (T, K), 0 where missing.
        K: (3, 3) intrinsics; fps: frames a second.
        joints: (T, 24, 3) a monocular estimator's joints in metres, NaN where not given, or None.
        noise_share: detector noise (one standard deviation) as a share of the person's size.
        focal_spread: how far K's focal length may be off (standard deviation of its logarithm);
            0: it is known.
    """

    xy_px: Array
    confidence: Array
    K: Array
    fps: float
    joints: Array | None = None
    noise_share: float = field(kw_only=True)
    focal_spread: float = 0.0

    @cached_property
    def size_px(self) -> Array:
        """(T,) how large the person is in each frame (`person_size_px`), found once."""
        return person_size_px(self)

    @property
    def sigma_px(self) -> Array:
        """(T,) detector noise in pixels, one standard deviation."""
        return self.noise_share * self.size_px


def every(observation: Observation, stride: int) -> Observation:
    """Every ``stride``-th frame of a video, as a video of a lower frame rate."""
    joints = observation.joints
    return replace(
        observation,
        xy_px=observation.xy_px[::stride],
        confidence=observation.confidence[::stride],
        fps=observation.fps / stride,
        joints=None if joints is None else joints[::stride],
    )


def person_size_px(observation: Observation) -> Array:
    """(T,) spread of the keypoints of each frame, made steady over about a second.

    The spread is the larger side of the box around the confident keypoints. The running maximum
    over a second stands for the person's true size when limbs fold; gaps take the median.
    """
    xy = np.where((observation.confidence > 0)[..., None], observation.xy_px, np.nan)
    seen = np.isfinite(xy).all(-1).sum(1) >= 4
    size = np.full(len(xy), np.nan)
    if seen.any():
        low, high = np.nanpercentile(xy[seen], [4, 96], axis=1)
        size[seen] = (high - low).max(-1)
    if not seen.any():
        return np.full(len(xy), 100.0)
    size = np.where(np.isfinite(size), size, np.nanmedian(size))
    half = max(1, round(observation.fps / 2))
    padded = np.pad(size, half, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1)
    return np.quantile(windows, 0.8, axis=1)


def without_jumps(observation: Observation) -> Array:
    """Confidence (T, K) with detections that leap away from their temporal median set to 0.

    A Hampel filter with a fixed share of the person's size: kind to fast motion, and only the
    starts of the fit use it (the fit itself is robust).
    """
    xy = np.where((observation.confidence > 0)[..., None], observation.xy_px, np.nan)
    width = HAMPEL_WINDOW
    padded = np.pad(xy, ((width, width), (0, 0), (0, 0)), constant_values=np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * width + 1, axis=0)
    count = np.isfinite(windows[..., 0, :]).sum(-1)
    filled = np.where(count[..., None, None] > 0, windows, 0.0)
    away = np.linalg.norm(xy - np.nanmedian(filled, axis=-1), axis=-1)
    wild = (count >= 3) & (away > HAMPEL_SHARE * observation.size_px[:, None])
    return np.where(wild | ~np.isfinite(away), 0.0, observation.confidence)


def padded(arrays: Sequence[Array], like: Tensor, fill: float = 0.0) -> Tensor:
    """Stack arrays (T_v, ...) to (B, T_max, ...)."""
    longest = max(len(a) for a in arrays)
    out = np.full((len(arrays), longest, *arrays[0].shape[1:]), fill)
    for row, array in zip(out, arrays, strict=True):
        row[: len(array)] = array
    return torch.as_tensor(out).to(like)


def validity(observations: Sequence[Observation], like: Tensor) -> Tensor:
    """(B, T_max) bool: which frames of the batch exist."""
    lengths = torch.tensor([len(o.xy_px) for o in observations], device=like.device)
    return torch.arange(int(lengths.max()), device=like.device) < lengths[:, None]


def per_video_view(observations: Sequence[Observation], like: Tensor) -> View:
    """Each video seen by its own camera, which is also the frame of its state."""
    xy, weights = [], []
    for o in observations:
        missing = ~np.isfinite(o.xy_px).all(-1) | (o.confidence <= 0)
        xy.append(np.where(missing[..., None], 0.0, o.xy_px))
        weights.append(np.where(missing, 0.0, o.confidence) / o.sigma_px[:, None] ** 2)
    batch = len(observations)
    eye = torch.eye(3).to(like).expand(batch, 3, 3)
    K = torch.as_tensor(np.stack([o.K for o in observations])).to(like)
    return View(padded(xy, like), padded(weights, like), K, eye, torch.zeros(batch, 3).to(like))
