"""One video's observations for a fit, and many videos as one padded batch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from imocap_core.camera.projection import project_camera
from imocap_core.motion.terms.view import View

HAMPEL_WINDOW = 3  # frames on each side
HAMPEL_SHARE = 0.25  # of the person's size: a larger distance to the median is an outlier


@dataclass(frozen=True)
class Observation:
    """One video's keypoints in its first frame's image.

    Attributes:
        xy_px: (T, K, 2), NaN where missing; confidence: (T, K), 0 where missing.
        K: (3, 3) intrinsics; fps: frames a second.
        joints: (T, 24, 3) a monocular estimator's joints in metres, NaN where not given, or None.
        noise_share: detector noise (one standard deviation) as a share of the person's size.
        focal_spread: standard deviation of the logarithm of K's focal length; 0: it is known.
        performer: number of the person shown, from 0; videos of one share a body shape.
        centre_m: (T, 3) place of a camera that moves, in its first frame's axes, or None: on one
            spot, or unknown.
        place_sd_m: (T,) standard deviation of the performer's place that comes of a moving camera's
            uncertain or unknown path, or None.
        up: (3,) against gravity as this video alone tells it, in its first frame's axes, and its
            standard deviation about each horizontal axis, degrees; or None.
    """

    xy_px: Float[np.ndarray, "T K 2"]
    confidence: Float[np.ndarray, "T K"]
    K: Float[np.ndarray, "3 3"]
    fps: float
    joints: Float[np.ndarray, "T 24 3"] | None = None
    noise_share: float = field(kw_only=True)
    focal_spread: float = 0.0
    performer: int = 0
    centre_m: Float[np.ndarray, "T 3"] | None = None
    place_sd_m: Float[np.ndarray, " T"] | None = None
    up: tuple[Float[np.ndarray, "3"], float] | None = None

    @cached_property
    def size_px(self) -> Float[np.ndarray, " T"]:
        """The person's size in each frame (`person_size_px`)."""
        return person_size_px(self)

    @property
    def sigma_px(self) -> Float[np.ndarray, " T"]:
        """Detector noise in pixels, one standard deviation."""
        return self.noise_share * self.size_px


def every(observation: Observation, stride: int) -> Observation:
    """Every ``stride``-th frame of a video, as a video of a lower frame rate."""
    joints, centre, sd = observation.joints, observation.centre_m, observation.place_sd_m
    return replace(
        observation,
        xy_px=observation.xy_px[::stride],
        confidence=observation.confidence[::stride],
        fps=observation.fps / stride,
        joints=None if joints is None else joints[::stride],
        centre_m=None if centre is None else centre[::stride],
        place_sd_m=None if sd is None else sd[::stride],
    )


def from_one_place(
    observation: Observation, xyz_m: Float[np.ndarray, "T K 3"]
) -> tuple[Observation, Float[np.ndarray, "3"]]:
    """The keypoints as a camera in the middle of a moving camera's path would see them, and that
    place; as they are, and the origin, where the camera is on one spot.

    Args:
        xyz_m: the keypoints' points in the axes of the first frame's camera: their parallax is
            added to the keypoints, which keep their errors.
    """
    centre = observation.centre_m
    if centre is None:
        return observation, np.zeros(3)
    middle, K = centre.mean(axis=0), observation.K
    before, after = (project_camera(xyz_m - c, K) for c in (centre[:, None], middle))
    xy_px = observation.xy_px + np.nan_to_num(after - before)
    return replace(observation, xy_px=xy_px, centre_m=None), middle


def person_size_px(observation: Observation) -> Float[np.ndarray, " T"]:
    """Spread of the keypoints of each frame, smoothed over about a second.

    The spread is the larger side of the box around the confident keypoints. Its running upper
    quantile over a second approximates the person's size when limbs fold; gaps take the median.
    """
    xy = np.where((observation.confidence > 0)[..., None], observation.xy_px, np.nan)
    visible, size = np.isfinite(xy).all(-1).sum(1) >= 4, np.full(len(xy), np.nan)
    if not visible.any():
        return np.full(len(xy), 100.0)
    low, high = (nan_quantile(xy[visible], q) for q in (0.04, 0.96))
    size[visible] = (high - low).max(-1)
    size = np.where(np.isfinite(size), size, np.nanmedian(size))
    half = max(1, round(observation.fps / 2))
    padded = np.pad(size, half, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1)
    return np.quantile(windows, 0.8, axis=1)


def nan_quantile(values: Float[np.ndarray, "T K C"], q: float) -> Float[np.ndarray, "T C"]:
    """Over the second axis, like numpy's nanquantile, which takes row by row in Python."""
    ordered = np.sort(values, axis=1)  # NaN comes last
    place = q * (np.isfinite(ordered).sum(axis=1, keepdims=True) - 1)
    ends = np.floor(place).astype(int), np.ceil(place).astype(int)
    below, above = (np.take_along_axis(ordered, end, axis=1) for end in ends)
    return np.asarray((below + (above - below) * (place % 1))[:, 0])


def without_jumps(observation: Observation) -> Float[np.ndarray, "T K"]:
    """Confidence, 0 for detections far from their temporal median.

    A Hampel filter whose threshold is a fixed share of the person's size, so that fast motion
    passes. Only the starts of the fit use it (the fit itself is robust).
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


def padded(
    arrays: Sequence[Float[np.ndarray, "_ ..."]], template: Tensor, fill: float = 0.0
) -> Float[Tensor, "B T ..."]:
    """Stack arrays (T_v, ...) to (B, T_max, ...); template: gives dtype and device."""
    longest = max(len(a) for a in arrays)
    out = np.full((len(arrays), longest, *arrays[0].shape[1:]), fill)
    for row, array in zip(out, arrays, strict=True):
        row[: len(array)] = array
    return torch.as_tensor(out).to(template)


def validity(observations: Sequence[Observation], template: Tensor) -> Bool[Tensor, "B T"]:
    """Frames of the batch that are no padding."""
    lengths = torch.tensor([len(o.xy_px) for o in observations], device=template.device)
    return torch.arange(int(lengths.max()), device=template.device) < lengths[:, None]


def per_video_view(observations: Sequence[Observation], template: Tensor) -> View:
    """Each video's own camera, in whose axes its state is."""
    xy, weights = [], []
    for o in observations:
        missing = ~np.isfinite(o.xy_px).all(-1) | (o.confidence <= 0)
        xy.append(np.where(missing[..., None], 0.0, o.xy_px))
        weights.append(np.where(missing, 0.0, o.confidence) / o.sigma_px[:, None] ** 2)
    batch = len(observations)
    eye = torch.eye(3).to(template).expand(batch, 3, 3)
    K = torch.as_tensor(np.stack([o.K for o in observations])).to(template)
    zero = torch.zeros(batch, 3).to(template)
    places = centres(observations, template)
    return View(padded(xy, template), padded(weights, template), K, eye, zero, centre=places)


def centres(observations: Sequence[Observation], template: Tensor) -> Float[Tensor, "B T 3"] | None:
    """Places of the cameras, each in its first frame's axes; None where none of them moves."""
    if all(o.centre_m is None for o in observations):
        return None
    still = (np.zeros((len(o.xy_px), 3)) for o in observations)
    rows = zip(observations, still, strict=True)
    return padded([zero if o.centre_m is None else o.centre_m for o, zero in rows], template)


def place_variance(
    observations: Sequence[Observation], template: Tensor
) -> Float[Tensor, "*batch"] | float:
    """(B, T) variances of the performers' places that come of moving cameras; 0.0: none moves."""
    if all(o.place_sd_m is None for o in observations):
        return 0.0
    still = (np.zeros(len(o.xy_px)) for o in observations)
    rows = zip(observations, still, strict=True)
    return padded([z if o.place_sd_m is None else o.place_sd_m for o, z in rows], template) ** 2
