"""A simulated 2D keypoint detector and 3D estimator with the kinds of errors that real ones have.

Errors scale with the person's size in the picture, a share of their variance is correlated over
time, and the confidence depends only partly on the error.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.signal import lfilter

from imocap_core.conventions import left_right_pairs, point_towards, sideless


@dataclass(frozen=True)
class KeypointErrors:
    """Errors of a kind of keypoint ("wrist" of both sides), relative to the detector's.

    noise, outliers: factors of the detector's noise and outlier_rate. towards, share: systematic
    offset by this share of the way to that point (`conventions.point_towards`; "" for none).
    """

    noise: float = 1.0
    outliers: float = 1.0
    towards: str = ""
    share: float = 0.0


def offset_target(name: str, by_kind: Mapping[str, KeypointErrors]) -> tuple[str, float]:
    """The point towards which a keypoint is offset, and the share of the way; ("", 0) for none."""
    errors = by_kind.get(sideless(name), KeypointErrors())
    return (point_towards(name, errors.towards), errors.share) if errors.towards else ("", 0.0)


def error_factors(
    names: Sequence[str], by_kind: Mapping[str, KeypointErrors]
) -> tuple[Float[np.ndarray, " K"], Float[np.ndarray, " K"]]:
    """Factors of the noise and of the outlier rate of each keypoint."""
    errors = [by_kind.get(sideless(name), KeypointErrors()) for name in names]
    return np.array([e.noise for e in errors]), np.array([e.outliers for e in errors])


def with_offsets(
    xy: Float[np.ndarray, "T K D"], names: Sequence[str], by_kind: Mapping[str, KeypointErrors]
) -> Float[np.ndarray, "T K D"]:
    """Keypoints with their systematic offsets; those whose target is not among the names stay."""
    offset = xy.copy()
    for k, name in enumerate(names):
        target, share = offset_target(name, by_kind)
        if target in names:
            offset[:, k] += share * (xy[:, names.index(target)] - xy[:, k])
    return offset


_ARM = ("shoulder", "elbow", "wrist")
_LEG = ("hip", "knee", "ankle", "heel", "big_toe", "small_toe")
_FACE = ("eye", "ear")


@dataclass(frozen=True)
class DetectorErrors:
    """Size of a detector's errors. Lengths are shares of the person's standing height in pixels.

    Attributes:
        noise: standard deviation per axis (4 px for a person 600 px tall).
        persistent_share, persistence_s: the share of its variance that is correlated over time, and
            the time constant.
        constant_offset: standard deviation per axis of an offset of each keypoint that stays
            constant over the video.
        difficulty_spread: standard deviation of the logarithm of each keypoint's difficulty in a
            video, a factor of its noise, its offset and (squared) its outliers.
        outlier_rate, outlier_noise, outlier_s: rate per keypoint and frame, standard deviation, and
            duration of an outlier (one frame at least).
        miss_rate: per keypoint and frame.
        swap_rate, swap_frames: rate per limb and frame of left-right swaps, and their duration.
        full_swap_rate: the same of swaps of the whole body.
        by_kind: errors particular to a kind of keypoint.
        false_person_rate, false_person_frames: rate per frame at which a false second person
            appears, and the duration.
    """

    noise: float = 4.0 / 600.0
    persistence_s: float = 0.3
    persistent_share: float = 0.5
    constant_offset: float = 0.0
    difficulty_spread: float = 0.0
    outlier_rate: float = 0.02
    outlier_noise: float = 0.10
    outlier_s: float = 0.0
    miss_rate: float = 0.02
    swap_rate: float = 0.007
    swap_frames: int = 3
    full_swap_rate: float = 0.0
    by_kind: Mapping[str, KeypointErrors] = field(default_factory=dict)
    false_person_rate: float = 0.01
    false_person_frames: int = 5


@dataclass(frozen=True)
class Detections:
    """Detected keypoints in pixels, with confidence; a missed one is all zeros, as in OpenPose."""

    xy_px: Float[np.ndarray, "*points 2"]
    confidence: Float[np.ndarray, "*points"]


def detect(
    xy_px: Float[np.ndarray, "T K 2"],
    height_px: Float[np.ndarray, " T"],
    names: Sequence[str],
    fps: float,
    rng: np.random.Generator,
    errors: DetectorErrors | None = None,
) -> Detections:
    """Simulated detection of one person.

    Args:
        xy_px: true keypoints. height_px: standing height of the person in the picture.
        names: of the keypoints. fps: frames per second. errors: None for the defaults.
    """
    errors = errors or DetectorErrors()
    shape = xy_px.shape[:2]
    scale = height_px[:, None, None]
    difficulty = _difficulty(shape[1], errors.difficulty_spread, rng)
    noise_factor, outlier_factor = error_factors(names, errors.by_kind)
    noise = persistent_noise(xy_px.shape, errors.persistence_s * fps, rng, errors.persistent_share)
    deviation = difficulty * noise_factor[:, None] * noise
    outlier_difficulty = difficulty[0, :, 0] ** 2 if errors.difficulty_spread > 0 else 1.0
    duration = max(1, round(errors.outlier_s * fps))
    rate = errors.outlier_rate * outlier_factor * outlier_difficulty / duration
    begins = rng.random(shape) < rate
    offset = scale * errors.noise * deviation
    offset += scale * hold(begins, rng.normal(0.0, errors.outlier_noise, xy_px.shape), duration)
    confidence = simulated_confidence(
        np.linalg.norm(offset, axis=-1) / (height_px[:, None] * errors.noise), rng
    )
    xy = _swap_limbs(with_offsets(xy_px, names, errors.by_kind), names, errors, rng) + offset
    if errors.constant_offset > 0:
        xy = xy + scale * difficulty * rng.normal(0.0, errors.constant_offset, (1, shape[1], 2))
    missed = rng.random(shape) < errors.miss_rate
    return Detections(np.where(missed[..., None], 0.0, xy), np.where(missed, 0.0, confidence))


def _difficulty(points: int, spread: float, rng: np.random.Generator) -> Float[np.ndarray, "1 K 1"]:
    """Difficulty of each keypoint in this video, of root mean square 1."""
    if spread > 0:
        return np.exp(rng.normal(-(spread**2), spread, (1, points, 1)))
    return rng.uniform(0.7, 1.3, (1, points, 1))


def persistent_noise(
    shape: tuple[int, ...],
    persistence_frames: float,
    rng: np.random.Generator,
    persistent_share: float = 0.5,
) -> Float[np.ndarray, "T ..."]:
    """Noise of unit variance, a share of it an AR(1) process along the first axis, the rest white.

    persistence_frames: time constant of the correlation.
    """
    rho = np.exp(-1.0 / persistence_frames)
    driven = rng.normal(size=shape)
    driven[1:] *= np.sqrt(1 - rho**2)
    slow = lfilter([1.0], [1.0, -rho], driven, axis=0)
    white = rng.normal(size=shape)
    share = 2.0 * persistent_share
    return (np.sqrt(share) * slow + np.sqrt(2.0 - share) * white) / np.sqrt(2.0)


def hold(
    begins: Bool[np.ndarray, "*B T K"],
    jumps: Float[np.ndarray, "*B T K 2"],
    frames: int | Int[np.ndarray, "*B 1 1"],
) -> Float[np.ndarray, "*B T K 2"]:
    """Sample and hold: the jump of the frame at which an outlier began, for `frames`; else 0."""
    time = np.arange(begins.shape[-2])[:, None]
    last = np.maximum.accumulate(np.where(begins, time, -frames), axis=-2)
    held_jumps = np.take_along_axis(jumps, np.maximum(last, 0)[..., None], axis=-3)
    return np.where((time - last < frames)[..., None], held_jumps, 0.0)


def simulated_confidence(
    error_in_sigma: Float[np.ndarray, "*points"], rng: np.random.Generator
) -> Float[np.ndarray, "*points"]:
    """Confidence that falls with the error; a fifth of it is random."""
    informed = 0.92 / (1.0 + (error_in_sigma / 6.0) ** 2)
    return np.clip(0.8 * informed + 0.2 * rng.beta(5, 2, error_in_sigma.shape), 0.05, 0.99)


def _swap_limbs(
    xy_px: Float[np.ndarray, "T K 2"],
    names: Sequence[str],
    errors: DetectorErrors,
    rng: np.random.Generator,
) -> Float[np.ndarray, "T K 2"]:
    """Left and right of arms, legs, face or the whole body swapped for short times."""
    pairs = left_right_pairs(names)
    swapped = xy_px
    for parts in (_ARM, _LEG, _FACE):
        limb = [pair for pair in pairs if names[pair[0]].removeprefix("left_") in parts]
        swapped = _swapped(swapped, limb, errors.swap_rate, errors.swap_frames, rng)
    if errors.full_swap_rate > 0:
        swapped = _swapped(swapped, pairs, errors.full_swap_rate, errors.swap_frames, rng)
    return swapped


def _swapped(
    xy_px: Float[np.ndarray, "T K 2"],
    pairs: Sequence[tuple[int, int]],
    rate: float,
    frames: int,
    rng: np.random.Generator,
) -> Float[np.ndarray, "T K 2"]:
    """Left and right of some pairs swapped for some frames at a time, `rate` of all frames."""
    swapped = xy_px.copy()
    left, right = [a for a, _ in pairs], [b for _, b in pairs]
    begins = rng.random(len(xy_px)) < rate / frames
    rows = np.flatnonzero(np.convolve(begins, np.ones(frames))[: len(xy_px)] > 0)[:, None]
    swapped[rows, left], swapped[rows, right] = xy_px[rows, right], xy_px[rows, left]
    return swapped


def false_people(
    performer: Detections,
    size: tuple[int, int],
    rng: np.random.Generator,
    errors: DetectorErrors | None = None,
) -> list[Detections | None]:
    """For each frame the false second person (K keypoints in one frame), or None.

    It is a copy of the performer, reduced in size, elsewhere in the picture, half of it missing. At
    least one appears in a video.
    """
    errors = errors or DetectorErrors()
    frames, count = performer.confidence.shape
    rate = errors.false_person_rate / errors.false_person_frames
    begins = np.flatnonzero(rng.random(frames) < rate)
    begins = np.append(begins, rng.integers(frames // 4, frames // 2))
    people: list[Detections | None] = [None] * frames
    for begin in begins:
        place = rng.uniform(0.1, 0.9, 2) * size
        scale = rng.uniform(0.25, 0.6)
        half = rng.random(count) < 0.5
        for frame in range(begin, min(begin + errors.false_person_frames, frames)):
            figure = performer.xy_px[frame]
            detected = performer.confidence[frame] > 0
            middle = figure[detected].mean(axis=0) if detected.any() else np.zeros(2)
            xy = place + scale * (figure - middle) + rng.normal(0.0, 2.0, figure.shape)
            visible = half & detected
            confidence = np.where(visible, rng.uniform(0.1, 0.5, count), 0.0)
            xy = np.where(visible[:, None], xy, 0.0)
            people[frame] = Detections(xy[None], confidence[None])
    return people
