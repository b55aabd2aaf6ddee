"""Poses as features that neither view, place, speed nor size of the picture change.

A feature is a short window of lifted poses about one moment: before, now and after. Windows are
compared after the best rotation of the whole window (Procrustes). Time is that of the action: at a
quarter of the speed, a film's frames are a quarter as far apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter1d

from imocap_core.collect.tracks import ShotTrack
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.mirror import REFLECTION, TWINS
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

LEAST_SIGMA_M = 0.06  # the joints next to the pelvis do not decide alone
USUAL_M = 0.1  # error of a lifted joint that has weight 1
_ONE = [JOINTS.index(TWINS[joint]) for joint in JOINTS]
MIRRORED = [len(JOINTS) * part + twin for part in range(3) for twin in _ONE]


@dataclass(frozen=True)
class TrackSamples:
    """A track's windows (3 * 14 joints) in metres, if it is played `rate` times as fast as the
    action. weights: inverse variances of the lifted joints, 0 where the person is not in the
    picture. frame: of the track, of each."""

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
    windows = np.concatenate(parts, axis=1)
    nearest = np.minimum(np.rint(frames).astype(int), len(poses) - 1)
    sigma = np.maximum(track.sigma_m[nearest][:, JOINTS], LEAST_SIGMA_M)
    precision = (USUAL_M / sigma) ** 2
    weights = np.concatenate([precision * track.visible[nearest][:, None]] * 3, axis=1)
    return TrackSamples(windows, weights, frames, rate)


def at_rate(rates: Sequence[TrackSamples], rate: float) -> TrackSamples:
    """A track's samples at one of its rates."""
    return next(samples for samples in rates if samples.rate == rate)


def mirrored(samples: TrackSamples) -> TrackSamples:
    """The windows in a mirror."""
    windows, weights = samples.windows[:, MIRRORED] * REFLECTION, samples.weights[:, MIRRORED]
    return replace(samples, windows=windows, weights=weights)


def squared_distances(a: TrackSamples, b: TrackSamples) -> Float[np.ndarray, "N M"]:
    """Weighted mean squared joint distances of windows, square metres; NaN where nobody is visible.

    A joint that the lifter could only guess, hidden behind the body, counts little.
    """
    return procrustes_distances(a.windows, b.windows, a.weights, b.weights) ** 2


def part_of(samples: TrackSamples, rows: slice | Bool[np.ndarray, " N"]) -> TrackSamples:
    """Some of the windows."""
    return replace(
        samples,
        windows=samples.windows[rows],
        weights=samples.weights[rows],
        frame=samples.frame[rows],
    )


def pooled(tracks: Sequence[TrackSamples]) -> TrackSamples:
    """The windows of several tracks together."""
    return replace(
        tracks[0],
        windows=np.concatenate([samples.windows for samples in tracks]),
        weights=np.concatenate([samples.weights for samples in tracks]),
        frame=np.concatenate([samples.frame for samples in tracks]),
    )


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
