"""A simulated 2D keypoint detector: wrong in the ways real ones are.

Its errors scale with the person's size in the picture, a share of their variance persists over
neighbouring frames, and its confidence knows only part of the truth.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from imocap_core.conventions import left_right_pairs
from imocap_core.render.arrays import Floats
from imocap_core.synthetic.marking import Marking, factors, marked

_ARM = ("shoulder", "elbow", "wrist")
_LEG = ("hip", "knee", "ankle", "heel", "big_toe", "small_toe")
_FACE = ("eye", "ear")


@dataclass(frozen=True)
class DetectorErrors:
    """How a detector errs. Lengths are shares of the person's standing height in the picture.

    noise: standard deviation per axis (4 px for a person 600 px tall); persistent, persistence_s:
    the share of its variance that is correlated, and its time constant; lasting: standard deviation
    per axis of an offset that a point keeps for the whole film; hard_spread: of the logarithm of
    how hard each point is in a film, for its noise, its offset and (squared) its outliers;
    outlier_noise: standard deviation of an outlier; the rates are per keypoint and frame, outliers
    in bouts of outlier_s (one frame at least), swap_rate per limb and frame in bouts of
    swap_frames, turn_rate of the whole body likewise; marking: what is particular to a kind of
    point; stranger_rate: chance per frame that a false second person appears for stranger_frames.
    """

    noise: float = 4.0 / 600.0
    persistence_s: float = 0.3
    persistent: float = 0.5
    lasting: float = 0.0
    hard_spread: float = 0.0
    outlier_rate: float = 0.02
    outlier_noise: float = 0.10
    outlier_s: float = 0.0
    miss_rate: float = 0.02
    swap_rate: float = 0.007
    swap_frames: int = 3
    turn_rate: float = 0.0
    marking: Mapping[str, Marking] = field(default_factory=dict)
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
    hard = _hardness(shape[1], errors.hard_spread, rng)  # some joints are harder than others
    harder, oftener = factors(names, errors.marking)
    lasts_frames = errors.persistence_s * fps
    deviation = (
        hard * harder[:, None] * persistent_noise(xy_px.shape, lasts_frames, rng, errors.persistent)
    )
    trouble = hard[0, :, 0] ** 2 if errors.hard_spread > 0 else 1.0
    bout = max(1, round(errors.outlier_s * fps))
    begins = rng.random(shape) < errors.outlier_rate * oftener * trouble / bout
    offset = scale * errors.noise * deviation
    offset += scale * held(begins, rng.normal(0.0, errors.outlier_noise, xy_px.shape), bout)
    confidence = believed(
        np.linalg.norm(offset, axis=-1) / (height_px[:, None] * errors.noise), rng
    )
    seen = _swap_limbs(marked(xy_px, names, errors.marking), names, errors, rng) + offset
    if errors.lasting > 0:
        seen = seen + scale * hard * rng.normal(0.0, errors.lasting, (1, shape[1], 2))
    missed = rng.random(shape) < errors.miss_rate
    return Detections(np.where(missed[..., None], 0.0, seen), np.where(missed, 0.0, confidence))


def _hardness(points: int, spread: float, rng: np.random.Generator) -> Floats:
    """(1, K, 1), of root mean square 1: how hard each point is in this film."""
    if spread > 0:
        drawn: Floats = np.exp(rng.normal(-(spread**2), spread, (1, points, 1)))
        return drawn
    return rng.uniform(0.7, 1.3, (1, points, 1))


def persistent_noise(
    shape: tuple[int, ...],
    persistence_frames: float,
    rng: np.random.Generator,
    persistent: float = 0.5,
) -> Floats:
    """Unit variance, `persistent` of it an AR(1) process along the first axis, the rest white."""
    rho = np.exp(-1.0 / persistence_frames)
    driven = rng.normal(size=shape)
    driven[1:] *= np.sqrt(1 - rho**2)
    slow = lfilter([1.0], [1.0, -rho], driven, axis=0)
    white = rng.normal(size=shape)
    share = 2.0 * persistent
    mixed: Floats = (np.sqrt(share) * slow + np.sqrt(2.0 - share) * white) / np.sqrt(2.0)
    return mixed


def held(begins: NDArray[np.bool_], jumps: Floats, frames: int | NDArray[np.int64]) -> Floats:
    """Each point's jump of the frame at which a bout began, for `frames`; else 0.

    Args:
        begins: (..., T, K); jumps: (..., T, K, 2); frames: one number, or (..., 1, 1).
    """
    time = np.arange(begins.shape[-2])[:, None]
    last = np.maximum.accumulate(np.where(begins, time, -frames), axis=-2)
    kept = np.take_along_axis(jumps, np.maximum(last, 0)[..., None], axis=-3)
    return np.where((time - last < frames)[..., None], kept, 0.0)


def believed(error_in_sigma: Floats, rng: np.random.Generator) -> Floats:
    """Falls with the error, but loosely: a fifth of what it says is its own invention."""
    known = 0.92 / (1.0 + (error_in_sigma / 6.0) ** 2)
    return np.clip(0.8 * known + 0.2 * rng.beta(5, 2, error_in_sigma.shape), 0.05, 0.99)


def _swap_limbs(
    xy_px: Floats, names: Sequence[str], errors: DetectorErrors, rng: np.random.Generator
) -> Floats:
    """Both arms, both legs or both halves of the face exchanged, in short bouts; or everything."""
    pairs = left_right_pairs(names)
    swapped = xy_px
    for parts in (_ARM, _LEG, _FACE):
        limb = [pair for pair in pairs if names[pair[0]].removeprefix("left_") in parts]
        swapped = _exchanged(swapped, limb, errors.swap_rate, errors.swap_frames, rng)
    if errors.turn_rate > 0:
        swapped = _exchanged(swapped, pairs, errors.turn_rate, errors.swap_frames, rng)
    return swapped


def _exchanged(
    xy_px: Floats,
    pairs: Sequence[tuple[int, int]],
    rate: float,
    frames: int,
    rng: np.random.Generator,
) -> Floats:
    """Left and right of some pairs exchanged in bouts of some frames, `rate` of the time."""
    swapped = xy_px.copy()
    left, right = [a for a, _ in pairs], [b for _, b in pairs]
    begins = rng.random(len(xy_px)) < rate / frames
    rows = np.flatnonzero(np.convolve(begins, np.ones(frames))[: len(xy_px)] > 0)[:, None]
    swapped[rows, left], swapped[rows, right] = xy_px[rows, right], xy_px[rows, left]
    return swapped
