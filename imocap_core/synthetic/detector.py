"""A simulated 2D keypoint detector: wrong in the ways real ones are.

Its errors scale with the person's size in the picture, half of their variance persists over
neighbouring frames, and its confidence knows only part of the truth.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from imocap_core.conventions import left_right_pairs
from imocap_core.render.arrays import Floats

_ARM = ("shoulder", "elbow", "wrist")
_LEG = ("hip", "knee", "ankle", "heel", "big_toe", "small_toe")
_FACE = ("eye", "ear")


@dataclass(frozen=True)
class DetectorErrors:
    """How a detector errs. Lengths are shares of the person's standing height in the picture.

    noise: standard deviation per axis (4 px for a person 600 px tall); persistence_s: time constant
    of the half of the variance that is correlated; outlier_noise: standard deviation of an outlier;
    the rates are per keypoint and frame, swap_rate per limb and frame in bouts of swap_frames;
    stranger_rate: chance per frame that a false second person appears for stranger_frames.
    """

    noise: float = 4.0 / 600.0
    persistence_s: float = 0.3
    outlier_rate: float = 0.02
    outlier_noise: float = 0.10
    miss_rate: float = 0.02
    swap_rate: float = 0.007
    swap_frames: int = 3
    stranger_rate: float = 0.01
    stranger_frames: int = 5


@dataclass(frozen=True)
class Detections:
    """xy_px (T, K, 2) and confidence (T, K); a missed keypoint is all zeros, as in OpenPose."""

    xy_px: Floats
    confidence: Floats


def detect(
    xy_px: Floats,
    height_px: Floats,
    names: Sequence[str],
    fps: float,
    rng: np.random.Generator,
    errors: DetectorErrors | None = None,
) -> Detections:
    """Detect a person whose true keypoints are xy_px (T, K, 2) and who is height_px (T,) tall."""
    errors = errors or DetectorErrors()
    shape = xy_px.shape[:2]
    scale = height_px[:, None, None]
    hard = rng.uniform(0.7, 1.3, (1, shape[1], 1))  # some joints are harder than others
    deviation = hard * persistent_noise(xy_px.shape, errors.persistence_s * fps, rng)
    outlier = rng.random(shape) < errors.outlier_rate
    offset = scale * errors.noise * deviation
    offset += outlier[..., None] * scale * rng.normal(0.0, errors.outlier_noise, xy_px.shape)
    confidence = believed(
        np.linalg.norm(offset, axis=-1) / (height_px[:, None] * errors.noise), rng
    )
    seen = _swap_limbs(xy_px, names, errors, rng) + offset
    missed = rng.random(shape) < errors.miss_rate
    return Detections(np.where(missed[..., None], 0.0, seen), np.where(missed, 0.0, confidence))


def persistent_noise(
    shape: tuple[int, ...], persistence_frames: float, rng: np.random.Generator
) -> Floats:
    """Unit variance, half of it white and half an AR(1) process along the first axis."""
    rho = np.exp(-1.0 / persistence_frames)
    driven = rng.normal(size=shape)
    driven[1:] *= np.sqrt(1 - rho**2)
    slow = lfilter([1.0], [1.0, -rho], driven, axis=0)
    mixed: Floats = (slow + rng.normal(size=shape)) / np.sqrt(2.0)
    return mixed


def believed(error_in_sigma: Floats, rng: np.random.Generator) -> Floats:
    """Falls with the error, but loosely: a fifth of what it says is its own invention."""
    known = 0.92 / (1.0 + (error_in_sigma / 6.0) ** 2)
    return np.clip(0.8 * known + 0.2 * rng.beta(5, 2, error_in_sigma.shape), 0.05, 0.99)


def _swap_limbs(
    xy_px: Floats, names: Sequence[str], errors: DetectorErrors, rng: np.random.Generator
) -> Floats:
    """Both arms, both legs or both halves of the face exchanged, in short bouts."""
    swapped = xy_px.copy()
    pairs = left_right_pairs(names)
    for parts in (_ARM, _LEG, _FACE):
        limb = [pair for pair in pairs if names[pair[0]].removeprefix("left_") in parts]
        left, right = [a for a, _ in limb], [b for _, b in limb]
        begins = rng.random(len(xy_px)) < errors.swap_rate / errors.swap_frames
        bout = np.convolve(begins, np.ones(errors.swap_frames))[: len(xy_px)] > 0
        rows = np.flatnonzero(bout)[:, None]
        swapped[rows, left], swapped[rows, right] = xy_px[rows, right], xy_px[rows, left]
    return swapped


def strangers(
    performer: Detections,
    size: tuple[int, int],
    rng: np.random.Generator,
    errors: DetectorErrors | None = None,
) -> list[Detections | None]:
    """For each frame the false second person a detector sees for a few frames, or None.

    It is the performer's own figure, shrunk, elsewhere in the picture, and half of it missing.
    Each entry holds one frame: xy_px (1, K, 2), confidence (1, K). There is at least one bout.
    """
    errors = errors or DetectorErrors()
    frames, count = performer.confidence.shape
    begins = np.flatnonzero(rng.random(frames) < errors.stranger_rate / errors.stranger_frames)
    begins = np.append(begins, rng.integers(frames // 4, frames // 2))
    found: list[Detections | None] = [None] * frames
    for begin in begins:
        place = rng.uniform(0.1, 0.9, 2) * size
        shrink = rng.uniform(0.25, 0.6)
        seen = rng.random(count) < 0.5
        for frame in range(begin, min(begin + errors.stranger_frames, frames)):
            figure = performer.xy_px[frame]
            known = performer.confidence[frame] > 0
            middle = figure[known].mean(axis=0) if known.any() else np.zeros(2)
            xy = place + shrink * (figure - middle) + rng.normal(0.0, 2.0, figure.shape)
            keep = seen & known
            confidence = np.where(keep, rng.uniform(0.1, 0.5, count), 0.0)
            found[frame] = Detections(np.where(keep[:, None], xy, 0.0)[None], confidence[None])
    return found
