"""Fingers that perform, and a simulated detector of hands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from imocap_core.hands.kinematics import joint_vectors
from imocap_core.hands.skeleton import ANGLE_NAMES, HandSkeleton
from imocap_core.render.arrays import Floats
from imocap_core.rotations import exp
from imocap_core.synthetic.detector import Detections, believed, persistent_noise

_STYLE_DEG = 6.0  # a performance's own way of holding each finger
_MOMENT_DEG = 4.0  # and at each key
_SPREAD_SHARE = 0.4  # of these, of angles that spread or twist
_ODD_DEG = 2.0  # of each joint about any axis: no hand bends about ideal axes
_NOISE = 0.03  # standard deviation of a point, share of the hand's length
_FLOOR_PX = 0.5
_PERSISTENCE_S = 0.3
_OUTLIER_RATE, _OUTLIER_NOISE, _MISS_RATE = 0.02, 0.3, 0.03
_LOST_PER_S, _LOST_S = 0.15, 0.4  # bouts in which a whole hand is not found


def perform_fingers(
    hands: Sequence[tuple[str, str]],
    poses: Mapping[str, Floats],
    key_times: Floats,
    time_s: Floats,
    skeleton: HandSkeleton,
    rng: np.random.Generator,
) -> Floats:
    """Local rotations (T, 30, 3, 3) of the left, then the right hand, in SMPL+H's order."""
    authored = np.array([[poses[name] for name in pair] for pair in hands])  # (N, 2, 21) degrees
    share = np.array([1.0 if "bend" in name else _SPREAD_SHARE for name in ANGLE_NAMES])
    style = rng.normal(0.0, _STYLE_DEG, authored.shape[1:])
    varied = authored + share * (style + rng.normal(0.0, _MOMENT_DEG, authored.shape))
    limits = [np.rad2deg(x.numpy()) for x in (skeleton.lower, skeleton.upper)]
    angles = PchipInterpolator(key_times, np.clip(varied, *limits))(time_s)
    vectors = joint_vectors(skeleton.axes, torch.as_tensor(np.deg2rad(angles)))
    odd = np.deg2rad(rng.normal(0.0, _ODD_DEG, vectors.shape[1:]))
    rotations: Floats = (exp(vectors) @ exp(torch.as_tensor(odd))).flatten(1, 3).numpy()
    return rotations


def detect_hands(
    xy_px: Floats,
    length_px: Floats,
    hidden: NDArray[np.bool_],
    fps: float,
    rng: np.random.Generator,
) -> Detections:
    """Detect hands whose true points are xy_px (T, 2, 21, 2).

    length_px (T, 2): of each hand in the picture; hidden (T, 2) bool: behind the body. Errors grow
    with the hand, half of their variance persists; a hand not found is all zeros.
    """
    frames = len(xy_px)
    sigma = np.hypot(_NOISE * length_px, _FLOOR_PX)[..., None, None]
    offset = sigma * persistent_noise(xy_px.shape, _PERSISTENCE_S * fps, rng)
    outlier = rng.random(xy_px.shape[:3]) < _OUTLIER_RATE
    stray = length_px[..., None, None] * rng.normal(0.0, _OUTLIER_NOISE, xy_px.shape)
    offset = offset + outlier[..., None] * stray
    confidence = believed(np.linalg.norm(offset, axis=-1) / sigma[..., 0], rng)
    begins = rng.random((frames, 2)) < _LOST_PER_S / fps
    bout = np.ones(max(1, round(_LOST_S * fps)))
    lost = np.stack([np.convolve(begins[:, s], bout)[:frames] > 0 for s in range(2)], axis=1)
    missed = (rng.random(xy_px.shape[:3]) < _MISS_RATE) | (lost | hidden)[..., None]
    return Detections(
        np.where(missed[..., None], 0.0, xy_px + offset), np.where(missed, 0.0, confidence)
    )
