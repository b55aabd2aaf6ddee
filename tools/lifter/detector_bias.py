"""How the detector of each training window errs: as guessed for any, or as measured for one.

Lengths are shares of the person's height in the picture. The measured ones are the level
`mediapipe` of imocap_core/synthetic/levels.py, made now better, now worse.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from imocap_core.lifter.network import RATE_HZ
from imocap_core.lifter.points import COMMON
from imocap_core.synthetic.detector import held
from imocap_core.synthetic.detector_levels import DETECTORS
from imocap_core.synthetic.marking import factors, target_of

MEASURED = 0.5  # share of windows
LEVEL = DETECTORS["mediapipe"]
OWN_PLACE = 0.006  # of detectors that were not measured: where a joint is marked, a point
AS_DETECTED = {"hip_seen": "hip", "hip": "", "shoulder_middle": "neck", "neck": "", "head": ""}


@dataclass(frozen=True)
class Habits:
    """Of B windows and K points.

    level (B,), noise (B, K): standard deviations per axis, of all and of each point; persistent,
    lasts_s (B,): share and time constant of what persists; lasting (B, K): of what stays; outliers
    (B, K): rate, bout (B,): their frames; misses (B,); towards (B, K): share of the way to
    `TARGETS`.
    """

    level: np.ndarray
    noise: np.ndarray
    persistent: np.ndarray
    lasts_s: np.ndarray
    lasting: np.ndarray
    outliers: np.ndarray
    bout: np.ndarray
    misses: np.ndarray
    towards: np.ndarray


def _as_detected(point: str) -> str:
    """The name under which a detector marks a common point; "" for SMPL's own joints."""
    side = point[: point.index("_") + 1] if point.startswith(("left_", "right_")) else ""
    kind = point.removeprefix(side)
    kind = AS_DETECTED.get(kind, kind)
    return side + kind if kind else ""


NAMES = tuple(_as_detected(point) for point in COMMON)
HARDER, OFTENER = factors(NAMES, LEVEL.marking)
_WAYS = [target_of(name, LEVEL.marking) for name in NAMES]
TARGETS = [NAMES.index(to) if to and to in NAMES else k for k, (to, _) in enumerate(_WAYS)]
SHARES = np.array([share for _, share in _WAYS])


def habits_of(count: int, rng: np.random.Generator) -> Habits:
    """Drawn anew for every window."""
    K = len(COMMON)
    measured = rng.random(count) < MEASURED
    guess = np.exp(rng.uniform(np.log(0.003), np.log(0.02), count))
    level = np.where(measured, LEVEL.noise * np.exp(rng.normal(size=count) * 0.25), guess)
    one = measured[:, None]
    harder, oftener = np.where(one, HARDER, 1.0), np.where(one, OFTENER, 1.0)
    rate = np.where(measured, LEVEL.outlier_rate * rng.uniform(0, 2, count),
                    rng.uniform(0.0, 0.06, count))  # fmt: skip
    hard = np.where(one, np.exp(rng.normal(-(LEVEL.hard_spread**2), LEVEL.hard_spread, (count, K))),
                    rng.uniform(0.7, 1.3, (count, K)))  # fmt: skip
    least = max(1, round(LEVEL.outlier_s * RATE_HZ))
    return Habits(
        level=level,
        noise=level[:, None] * harder * hard,
        persistent=np.where(measured, LEVEL.persistent, 0.5),
        lasts_s=np.where(measured, LEVEL.persistence_s, 0.3),
        lasting=np.where(one, LEVEL.lasting * hard, OWN_PLACE),
        outliers=rate[:, None] * oftener * np.where(one, hard**2, 1.0),
        bout=np.where(measured, rng.integers(least, least + 2, count), 1),
        misses=np.where(measured, 2 * LEVEL.miss_rate, 0.08) * rng.random(count),
        towards=SHARES * (one * rng.uniform(0.4, 1.6, (count, 1))),
    )


def persistent(habits: Habits, frames: int, rng: np.random.Generator) -> np.ndarray:
    """(B, L, K, 2) of unit variance, a share of it persisting along axis 1."""
    shape = (len(habits.level), frames, len(COMMON), 2)
    rho = np.exp(-1.0 / (habits.lasts_s * RATE_HZ))[:, None, None].astype(np.float32)
    share = habits.persistent[:, None, None, None].astype(np.float32)
    white = rng.standard_normal(shape, dtype=np.float32)
    slow = rng.standard_normal(shape, dtype=np.float32)
    for t in range(1, frames):
        slow[:, t] = rho * slow[:, t - 1] + np.sqrt(1 - rho**2) * slow[:, t]
    mixed: np.ndarray = np.sqrt(share) * slow + np.sqrt(1 - share) * white
    return mixed


def jumps(habits: Habits, frames: int, rng: np.random.Generator) -> np.ndarray:
    """(B, L, K, 2) of outliers, each held through its bout; 0 elsewhere."""
    shape = (len(habits.level), frames, len(COMMON))
    bout = habits.bout[:, None, None]
    begins = rng.random(shape) < habits.outliers[:, None] / bout
    far = rng.standard_normal((*shape, 2), dtype=np.float32) * LEVEL.outlier_noise
    return held(begins, far, bout)


def marked(rays: Tensor, habits: Habits) -> Tensor:
    """Rays (B, L, K, 2) of the places that are marked instead."""
    share = torch.as_tensor(habits.towards, dtype=torch.float32)[:, None, :, None]
    return rays + share * (rays[:, :, TARGETS] - rays)
