"""Detection errors of each training window: of an unknown detector, or as measured of MediaPipe.

Lengths are shares of the person's height in the picture. The measured errors are the preset
`mediapipe` of benchmarks/synthetic/simulated.py, with random factors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from benchmarks.synthetic.simulated import DETECTORS
from imocap_core.lifter.lifter_network import COMMON, RATE_HZ
from imocap_core.synthetic.detector import error_factors, hold, offset_target

MEASURED = 0.5  # share of windows
PRESET = DETECTORS["mediapipe"]
CONSTANT_OFFSET = 0.006  # standard deviation, of detectors that were not measured
AS_DETECTED = {"hip_seen": "hip", "hip": "", "shoulder_middle": "neck", "neck": "", "head": ""}


@dataclass(frozen=True)
class WindowErrors:
    """Of B windows and K points.

    typical_noise (B,), noise (B, K): standard deviations per axis, of all and of each point;
    persistent_share, persistence_s (B,): of the correlated part; constant_offset (B, K); outliers
    (B, K): rate; outlier_frames (B,): their duration; misses (B,); towards (B, K): share of the way
    to `TARGETS`.
    """

    typical_noise: np.ndarray
    noise: np.ndarray
    persistent_share: np.ndarray
    persistence_s: np.ndarray
    constant_offset: np.ndarray
    outliers: np.ndarray
    outlier_frames: np.ndarray
    misses: np.ndarray
    towards: np.ndarray


def _as_detected(point: str) -> str:
    """A detector's name for a common point; "" for SMPL's joints."""
    side = point[: point.index("_") + 1] if point.startswith(("left_", "right_")) else ""
    kind = point.removeprefix(side)
    kind = AS_DETECTED.get(kind, kind)
    return side + kind if kind else ""


NAMES = tuple(_as_detected(point) for point in COMMON)
NOISE_FACTORS, OUTLIER_FACTORS = error_factors(NAMES, PRESET.by_kind)
_OFFSETS = [offset_target(name, PRESET.by_kind) for name in NAMES]
TARGETS = [NAMES.index(to) if to and to in NAMES else k for k, (to, _) in enumerate(_OFFSETS)]
SHARES = np.array([share for _, share in _OFFSETS])


def draw_errors(count: int, rng: np.random.Generator) -> WindowErrors:
    """Random errors for each of some windows."""
    K = len(COMMON)
    measured = rng.random(count) < MEASURED
    guess = np.exp(rng.uniform(np.log(0.003), np.log(0.02), count))
    typical = np.where(measured, PRESET.noise * np.exp(rng.normal(size=count) * 0.25), guess)
    one = measured[:, None]
    noise_factor = np.where(one, NOISE_FACTORS, 1.0)
    outlier_factor = np.where(one, OUTLIER_FACTORS, 1.0)
    rate = np.where(measured, PRESET.outlier_rate * rng.uniform(0, 2, count),
                    rng.uniform(0.0, 0.06, count))  # fmt: skip
    spread = PRESET.difficulty_spread
    difficulty = np.where(one, np.exp(rng.normal(-(spread**2), spread, (count, K))),
                          rng.uniform(0.7, 1.3, (count, K)))  # fmt: skip
    least = max(1, round(PRESET.outlier_s * RATE_HZ))
    return WindowErrors(
        typical_noise=typical,
        noise=typical[:, None] * noise_factor * difficulty,
        persistent_share=np.where(measured, PRESET.persistent_share, 0.5),
        persistence_s=np.where(measured, PRESET.persistence_s, 0.3),
        constant_offset=np.where(one, PRESET.constant_offset * difficulty, CONSTANT_OFFSET),
        outliers=rate[:, None] * outlier_factor * np.where(one, difficulty**2, 1.0),
        outlier_frames=np.where(measured, rng.integers(least, least + 2, count), 1),
        misses=np.where(measured, 2 * PRESET.miss_rate, 0.08) * rng.random(count),
        towards=SHARES * (one * rng.uniform(0.4, 1.6, (count, 1))),
    )


def persistent_noise(errors: WindowErrors, frames: int, rng: np.random.Generator) -> np.ndarray:
    """(B, L, K, 2) of unit variance, a share of it an AR(1) process along axis 1."""
    shape = (len(errors.typical_noise), frames, len(COMMON), 2)
    rho = np.exp(-1.0 / (errors.persistence_s * RATE_HZ))[:, None, None].astype(np.float32)
    share = errors.persistent_share[:, None, None, None].astype(np.float32)
    white = rng.standard_normal(shape, dtype=np.float32)
    slow = rng.standard_normal(shape, dtype=np.float32)
    for t in range(1, frames):
        slow[:, t] = rho * slow[:, t - 1] + np.sqrt(1 - rho**2) * slow[:, t]
    return np.sqrt(share) * slow + np.sqrt(1 - share) * white


def outlier_jumps(errors: WindowErrors, frames: int, rng: np.random.Generator) -> np.ndarray:
    """(B, L, K, 2) of outliers, each constant for its duration; 0 elsewhere."""
    shape = (len(errors.typical_noise), frames, len(COMMON))
    duration = errors.outlier_frames[:, None, None]
    begins = rng.random(shape) < errors.outliers[:, None] / duration
    far = rng.standard_normal((*shape, 2), dtype=np.float32) * PRESET.outlier_noise
    return hold(begins, far, duration)


def with_offsets(rays: Tensor, errors: WindowErrors) -> Tensor:
    """Rays (B, L, K, 2) with the systematic offsets of their points."""
    share = torch.as_tensor(errors.towards, dtype=torch.float32)[:, None, :, None]
    return rays + share * (rays[:, :, TARGETS] - rays)
