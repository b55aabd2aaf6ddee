"""People who move, filmed from anywhere at any speed: tracks without a detector."""

from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from imocap_core.collect.films import ShotTrack
from imocap_core.motion.state import mirrored_joints

FPS = 30.0


def movement(seed: int, duration_s: float = 2.0) -> CubicSpline:
    """Joints (24, 3) in metres over seconds: a stance, from which every joint moves smoothly."""
    stance = np.random.default_rng(0).normal(0, [0.25, 0.5, 0.15], (24, 3))
    rng = np.random.default_rng(seed)
    knots = np.linspace(0, duration_s, max(5, round(3 * duration_s)))
    moved = rng.normal(0, 0.22, (len(knots), 24, 3))
    moved[[0, -1]] = 0
    return CubicSpline(knots, stance + moved)


def track(
    motion: CubicSpline,
    *,
    shot: int = 0,
    rate: float = 1.0,
    azimuth_deg: float = 0.0,
    mirrored: bool = False,
    pause_s: float = 0.5,
    noise_m: float = 0.02,
    **fields: Any,
) -> ShotTrack:
    """A movement, with a pause before and after it, in frames of a track.

    azimuth_deg: of the camera. rate: of the playback.
    """
    end = float(motion.x[-1])
    time = np.arange(-pause_s, end + pause_s, rate / FPS)
    joints = motion(np.clip(time, 0, end))
    joints = Rotation.from_euler("y", azimuth_deg, degrees=True).apply(joints.reshape(-1, 3))
    joints = joints.reshape(-1, 24, 3)
    joints = mirrored_joints(joints) if mirrored else joints
    joints = joints + np.random.default_rng(shot).normal(0, noise_m, joints.shape)
    count = len(joints)
    xy = 320 + 100 * joints[..., :2]
    box = np.concatenate([xy.min(axis=1), xy.max(axis=1)], axis=1)
    usual: dict[str, Any] = {
        "film": 0,
        "shot": shot,
        "track": 0,
        "first": 1000 * shot,
        "fps": FPS,
        "joints": joints,
        "sigma_m": np.full(joints.shape[:2], 0.1),
        "visible": np.ones(count, dtype=bool),
        "xy_px": xy,
        "confidence": np.ones((count, 24)),
        "box_px": box,
    }
    return ShotTrack(**(usual | fields))


def joined(*tracks: ShotTrack) -> ShotTrack:
    """One after the other, as the track of the first one."""
    rows = ("joints", "sigma_m", "visible", "xy_px", "confidence", "box_px")
    of_all = {name: np.concatenate([vars(t)[name] for t in tracks]) for name in rows}
    return ShotTrack(**{**vars(tracks[0]), **of_all})
