"""Poses as features that neither view, place, speed nor size of the picture change.

A feature is a short window of lifted poses about one moment: before, now and after. Windows are
compared after the best rotation of the whole window (Procrustes). Time is that of the action: at a
quarter of the speed, a film's frames are a quarter as far apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d

from imocap_core.collect.tracks import ShotTrack
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.mirror import mirrored_joints
from imocap_core.sync.pairwise.procrustes import procrustes_distances

RATE_HZ = 12.0  # samples a second of the action
WINDOW_S = 0.15  # of the action, from the middle of a window to its ends
RATES = (0.25, 0.5, 1.0, 2.0)  # playback rates; the warp covers those between them
JOINTS = [
    SMPL_JOINTS.index(name)
    for name in (
        *("left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle"),
        *("neck", "head", "left_shoulder", "right_shoulder"),
        *("left_elbow", "right_elbow", "left_wrist", "right_wrist"),
    )
]


@dataclass(frozen=True)
class TrackSamples:
    """A track's windows (3 * 14 joints) in metres, if it is played `rate` times as fast as the
    action. weights: 0 where the person is not in the picture. frame: of the track, of each."""

    windows: Float[np.ndarray, "N P 3"]
    weights: Float[np.ndarray, "N P"]
    frame: Float[np.ndarray, " N"]
    rate: float


def samples_of(track: ShotTrack, rate: float) -> TrackSamples:
    """Windows of a track in the action's time."""
    step = track.fps / (RATE_HZ * rate)
    frames = np.arange(0.0, len(track.joints), step)
    reach = track.fps * WINDOW_S / rate
    poses = track.joints[:, JOINTS]
    poses = poses - poses.mean(axis=1, keepdims=True)
    smooth = gaussian_filter1d(poses, max(0.4 * step, 0.5), axis=0, mode="nearest")
    parts = [_at(smooth, frames + offset) for offset in (-reach, 0.0, reach)]
    shown = track.visible[np.minimum(np.rint(frames).astype(int), len(poses) - 1)]
    windows = np.concatenate(parts, axis=1)
    weights = np.repeat(shown.astype(float)[:, None], windows.shape[1], axis=1)
    return TrackSamples(windows, weights, frames, rate)


def mirrored(windows: Float[np.ndarray, "N P 3"]) -> Float[np.ndarray, "N P 3"]:
    """The windows in a mirror."""
    full = np.zeros((len(windows), 3, len(SMPL_JOINTS), 3))
    full[:, :, JOINTS] = windows.reshape(len(windows), 3, len(JOINTS), 3)
    return mirrored_joints(full)[:, :, JOINTS].reshape(windows.shape)


def squared_distances(
    a: Float[np.ndarray, "N P 3"],
    b: Float[np.ndarray, "M P 3"],
    weights: Float[np.ndarray, "M P"],
) -> Float[np.ndarray, "N M"]:
    """Mean squared joint distances of windows, square metres; NaN where nobody is visible."""
    return procrustes_distances(a, b, np.ones(a.shape[:2]), weights) ** 2


def pose_change(windows: Float[np.ndarray, "N P 3"]) -> Float[np.ndarray, " N"]:
    """Root mean square movement of the joints within each window, metres."""
    joints = len(JOINTS)
    step = windows[:, 2 * joints :] - windows[:, :joints]
    return np.asarray(np.sqrt((step**2).sum(axis=-1).mean(axis=-1)))


def _at(poses: Float[np.ndarray, "T J 3"], frames: Float[np.ndarray, " N"]) -> np.ndarray:
    """Poses between frames, interpolated; the first and the last beyond the ends."""
    position = np.clip(frames, 0, len(poses) - 1)
    low = np.minimum(position.astype(int), max(len(poses) - 2, 0))
    high = np.minimum(low + 1, len(poses) - 1)
    share = (position - low)[:, None, None]
    return np.asarray((1 - share) * poses[low] + share * poses[high])


def all_samples(tracks: Sequence[ShotTrack]) -> list[list[TrackSamples]]:
    """Per track, its samples at every rate that its length allows."""
    return [[samples_of(track, rate) for rate in RATES] for track in tracks]
