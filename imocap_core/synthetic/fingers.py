"""Finger motion of a choreography, and a simulated detector of hands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.interpolate import PchipInterpolator

from imocap_core.hands.kinematics import joint_vectors
from imocap_core.hands.skeleton import ANGLE_NAMES, HandSkeleton
from imocap_core.rotations import exp
from imocap_core.synthetic.detector import Detections, persistent_noise, simulated_confidence

_STYLE_DEG = 6.0  # standard deviation of each angle from performance to performance,
_MOMENT_DEG = 4.0  # and from key to key
_SPREAD_SHARE = 0.4  # of these, for angles that spread or twist
_ODD_DEG = 2.0  # of each joint about any axis: real joints have no ideal axes
_NOISE = 0.03  # standard deviation of a point, share of the hand's length
_FLOOR_PX = 0.5
_PERSISTENCE_S = 0.3
_OUTLIER_RATE, _OUTLIER_NOISE, _MISS_RATE = 0.02, 0.3, 0.03
_LOST_PER_S, _LOST_S = 0.15, 0.4  # times in which a whole hand is not detected


def perform_fingers(
    hands: Sequence[tuple[str, str]],
    poses: Mapping[str, Float[np.ndarray, "21"]],
    key_times: Float[np.ndarray, " N"],
    time_s: Float[np.ndarray, " T"],
    skeleton: HandSkeleton,
    rng: np.random.Generator,
) -> Float[np.ndarray, "T 30 3 3"]:
    """Local finger rotations of the left, then the right hand, in SMPL+H's order.

    hands: names of the left and right hand's pose at each of the N keys. poses: angles in degrees.
    """
    authored = np.array([[poses[name] for name in pair] for pair in hands])  # (N, 2, 21) degrees
    share = np.array([1.0 if "bend" in name else _SPREAD_SHARE for name in ANGLE_NAMES])
    style = rng.normal(0.0, _STYLE_DEG, authored.shape[1:])
    varied = authored + share * (style + rng.normal(0.0, _MOMENT_DEG, authored.shape))
    limits = [np.rad2deg(x.numpy()) for x in (skeleton.lower, skeleton.upper)]
    angles = PchipInterpolator(key_times, np.clip(varied, *limits))(time_s)
    vectors = joint_vectors(skeleton.axes, torch.as_tensor(np.deg2rad(angles)))
    odd = np.deg2rad(rng.normal(0.0, _ODD_DEG, vectors.shape[1:]))
    return (exp(vectors) @ exp(torch.as_tensor(odd))).flatten(1, 3).numpy()


def detect_hands(
    xy_px: Float[np.ndarray, "T 2 21 2"],
    length_px: Float[np.ndarray, "T 2"],
    hidden: Bool[np.ndarray, "T 2"],
    fps: float,
    rng: np.random.Generator,
) -> Detections:
    """Simulated detection of both hands.

    Errors are proportional to the hand's length, half of their variance is correlated over time; a
    hand that is not detected is all zeros.

    Args:
        xy_px: true points. length_px: of each hand in the picture. hidden: behind the body.
    """
    frames = len(xy_px)
    sigma = np.hypot(_NOISE * length_px, _FLOOR_PX)[..., None, None]
    offset = sigma * persistent_noise(xy_px.shape, _PERSISTENCE_S * fps, rng)
    outlier = rng.random(xy_px.shape[:3]) < _OUTLIER_RATE
    jump = length_px[..., None, None] * rng.normal(0.0, _OUTLIER_NOISE, xy_px.shape)
    offset = offset + outlier[..., None] * jump
    confidence = simulated_confidence(np.linalg.norm(offset, axis=-1) / sigma[..., 0], rng)
    begins = rng.random((frames, 2)) < _LOST_PER_S / fps
    duration = np.ones(max(1, round(_LOST_S * fps)))
    lost = np.stack([np.convolve(begins[:, s], duration)[:frames] > 0 for s in range(2)], axis=1)
    missed = (rng.random(xy_px.shape[:3]) < _MISS_RATE) | (lost | hidden)[..., None]
    return Detections(
        np.where(missed[..., None], 0.0, xy_px + offset), np.where(missed, 0.0, confidence)
    )
