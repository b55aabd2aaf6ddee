"""Random cameras and a simulated detector: the lifter's training inputs.

Errors are of the kinds of imocap_core/synthetic/detector.py, lengths are shares of the person's
height in the picture, with noise from below the benchmarks' `fine_tuned` detector to above their
`generic` one.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from imocap_core.conventions import left_right_pairs
from imocap_core.lifter.lifter_network import COMMON, columns_of
from lifter.window_errors import draw_errors, outlier_jumps, persistent_noise, with_offsets

STATURE_M = 1.7
HIDDEN = 0.12  # share of windows in which an arm or a leg is hidden, for up to all of it
LAYOUTS = ("body25", "body25b", "coco17", "coco18", "halpe26", "h36m17", "mediapipe33", "coco18")
FACE = tuple(k for k, n in enumerate(COMMON) if n in
             ("nose", "left_eye", "right_eye", "left_ear", "right_ear", "head_top"))  # fmt: skip
FEET = tuple(k for k, n in enumerate(COMMON) if "toe" in n or "heel" in n)
PAIRS = left_right_pairs(COMMON)
LIMBS = tuple(
    tuple(pair for pair in left_right_pairs(COMMON)
          if COMMON[pair[0]].removeprefix("left_") in parts)
    for parts in (("shoulder", "elbow", "wrist"),
                  ("hip_seen", "hip", "knee", "ankle", "big_toe", "small_toe", "heel"),
                  ("eye", "ear"))
)  # fmt: skip


def film_windows(points: Tensor, joints: Tensor, rng: np.random.Generator) -> tuple[Tensor, ...]:
    """Points (B, L, K, 3), z up, in random cameras.

    Returns rays (B, L, K, 2) by an approximately known focal length, the person's height in rays
    (B,), and the joints (B, L, 24, 3) in camera axes.
    """
    count = len(points)
    R = _orientations(count, rng)
    distance = np.exp(rng.uniform(np.log(2.2), np.log(12.0), count))
    aside = rng.normal(size=(count, 2)) * (0.16, 0.09)
    depth = np.maximum(distance, 1.8)
    place = np.column_stack([aside[:, 0] * depth, aside[:, 1] * depth, depth])
    place = torch.as_tensor(place, dtype=torch.float32)
    x, j = (torch.einsum("bij,blkj->blki", R, p) for p in (points, joints))
    x, j = x + place[:, None, None], j + place[:, None, None]
    nearest = x[..., 2].flatten(1).min(1).values
    push = (0.6 - nearest).clamp_min(0.0)[:, None, None]
    z = x[..., 2] + push
    j[..., 2] += push
    exact = rng.random(count) < 0.4
    wrong = np.where(exact, 1.0, np.exp(rng.normal(size=count) * 0.13))
    factor = torch.as_tensor(wrong, dtype=torch.float32)[:, None, None, None]
    height = STATURE_M / j[:, :, 0, 2].mean(1) * factor[:, 0, 0, 0]
    return x[..., :2] / z[..., None] * factor, height, j


def detect(rays: Tensor, height: Tensor, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
    """Rays (B, L, K, 2) and confidences (B, L, K) of a simulated detector with a random layout."""
    count, frames, K = rays.shape[:3]
    errors = draw_errors(count, rng)
    noise = errors.noise[:, None]
    offset = noise[..., None] * persistent_noise(errors, frames, rng)
    offset += outlier_jumps(errors, frames, rng)
    error = np.linalg.norm(offset, axis=-1) / errors.typical_noise[:, None, None]
    constant = rng.normal(size=(count, 1, K, 2)) * errors.constant_offset[:, None, :, None]
    trust = _simulated_confidence(error, rng)
    plain = rng.random(count) < 0.25  # detectors without confidences
    trust[plain] = 1.0
    missed = rng.random((count, frames, K)) < errors.misses[:, None, None]
    swapped = _swapped(with_offsets(rays, errors), rng)
    detected = swapped + height[:, None, None, None] * torch.as_tensor(
        offset + constant, dtype=torch.float32
    )
    hidden = missed | ~_available(count, frames, rng)
    confidence = torch.as_tensor(np.where(hidden, 0.0, trust), dtype=torch.float32)
    return torch.where(confidence[..., None] > 0, detected, 0.0), confidence


def _orientations(count: int, rng: np.random.Generator) -> Tensor:
    """R_cam_from_world (B, 3, 3): any azimuth, eye level mostly, a little roll."""
    azimuth = rng.uniform(0, 2 * np.pi, count)
    high = np.deg2rad(np.where(rng.random(count) < 0.7, rng.normal(6, 8, count),
                               rng.uniform(-20, 55, count)))  # fmt: skip
    roll = np.deg2rad(rng.normal(0, 3, count))
    ca, sa, ce, se, cr, sr = (f(v) for v in (azimuth, high, roll) for f in (np.cos, np.sin))
    none = np.zeros(count)
    right = np.stack([ca, sa, none], -1)
    forward = np.stack([-sa * ce, ca * ce, -se], -1)
    down = np.cross(forward, right)
    x = cr[:, None] * right + sr[:, None] * down
    y = -sr[:, None] * right + cr[:, None] * down
    return torch.as_tensor(np.stack([x, y, forward], 1), dtype=torch.float32)


def _simulated_confidence(error_in_sigma: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """As imocap_core.synthetic.detector.simulated_confidence, but normal instead of beta."""
    informed = 0.92 / (1.0 + (error_in_sigma / 6.0) ** 2)
    random = np.clip(rng.normal(0.71, 0.16, error_in_sigma.shape), 0, 1)
    return np.clip(0.8 * informed + 0.2 * random, 0.05, 0.99)


def _swapped(rays: Tensor, rng: np.random.Generator) -> Tensor:
    """Left and right of arms, legs or faces swapped for short times, more rarely the whole body."""
    swapped = rays.clone()
    count, frames = rays.shape[:2]
    time = np.arange(frames)
    for limb, share in (*((limb, 0.12) for limb in LIMBS), (PAIRS, 0.06)):
        begin = rng.integers(-3, frames, count)
        length = np.where(rng.random(count) < share, rng.integers(1, 5, count), 0)
        during = (time >= begin[:, None]) & (time < (begin + length)[:, None])
        b, t = (torch.as_tensor(i)[:, None] for i in np.nonzero(during))
        left, right = [p for p, _ in limb], [q for _, q in limb]
        before = swapped.clone()
        swapped[b, t, left], swapped[b, t, right] = before[b, t, right], before[b, t, left]
    return swapped


def _available(count: int, frames: int, rng: np.random.Generator) -> np.ndarray:
    """(B, L, K) bool: points of the layout that are in the picture, not hidden, within the clip."""
    tables = np.stack([np.isin(np.arange(len(COMMON)), columns_of(x)[1]) for x in LAYOUTS])
    available = np.repeat(tables[rng.integers(len(LAYOUTS), size=count)][:, None], frames, 1)
    for rows, columns in (
        (rng.random(count) < 0.25, list(FACE)),
        (rng.random(count) < 0.15, list(FEET)),
    ):
        available[np.ix_(rows, np.ones(frames, bool), columns)] = False
    time = np.arange(frames)
    for limb in LIMBS[:2]:
        for side in (0, 1):
            rows = np.flatnonzero(rng.random(count) < HIDDEN)
            for row in rows:
                begin = rng.integers(-6, frames)
                some = [pair[side] for pair in limb][rng.integers(0, 3) :]
                available[row][
                    np.ix_((time >= begin) & (time < begin + rng.integers(3, frames)), some)
                ] = False
    first = np.where(rng.random(count) < 0.15, rng.integers(0, frames - 4, count), 0)
    last = np.where(rng.random(count) < 0.15, rng.integers(4, frames + 1, count), frames)
    inside = (time >= first[:, None]) & (time < np.maximum(last, first + 3)[:, None])
    gone = rng.random((count, frames)) < np.where(rng.random(count) < 0.1, 0.1, 0.0)[:, None]
    return available & (inside & ~gone)[..., None]
