"""Motions that wander smoothly, and what level cameras see of them."""

import numpy as np

from imocap_core.sync.screening.registration import Keypoints2D


def wandering(seed: int, joints: int, frames: int) -> np.ndarray:
    """Joints (T, J, 3), each in its own way, without any symmetry."""
    rng = np.random.default_rng(seed)
    start, first, second = rng.normal(size=(3, joints, 3))
    t = np.linspace(0.0, 1.0, frames)[:, None, None]
    return start + first * np.sin(4 * t) + second * np.cos(5 * t)


def view_of(motion: np.ndarray, azimuth: float) -> np.ndarray:
    """The motion in the axes of a level camera at an azimuth."""
    c, s = np.cos(azimuth), np.sin(azimuth)
    return np.asarray(motion @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T)


def filmed(motion: np.ndarray) -> Keypoints2D:
    """By a camera that is near enough for perspective to matter a little."""
    xy = 900 * motion[..., :2] / (motion[..., 2:] + 30.0) + 300
    return Keypoints2D(xy, np.ones(xy.shape[:2]))
