"""Scenes for measuring synchronisation alone: poses of a simulated estimator, and the truth.

No file is written and no stage is run: captured motion before four virtual cameras goes through the
simulated monocular estimator straight into `synchronise`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from benchmarks.actions.captured import SIZE, CapturedVideo, protocol_videos, trial_videos
from benchmarks.synthetic.captured import CAMERA_PLACEMENTS, place_camera
from benchmarks.synthetic.estimator import estimate

SEED = 11


@dataclass(frozen=True)
class SyncScene:
    """Videos of one action: per video poses in camera axes (metres), rising phases, and fps.

    events: the frame of one moment of the action in each video.
    """

    name: str
    poses: list[Float[np.ndarray, "T 14 3"]]
    phases: list[Float[np.ndarray, " T"]]
    fps: list[float]
    phase_end: float
    events: list[int] | None = None

    @property
    def frames(self) -> int:
        """Number of frames of all videos."""
        return sum(map(len, self.poses))


def filmed_scene(
    name: str,
    joints_m: Sequence[Float[np.ndarray, "T 14 3"]],
    phases: Sequence[Float[np.ndarray, " T"]],
    frames: Sequence[Int[np.ndarray, " N"]],
    fps: float,
    *,
    seed: int = SEED,
    **more: object,
) -> SyncScene:
    """A scene of performances on the stage, z up, at `fps`; video v is filmed from viewpoint v and
    shows some frames of its performance. `more`: further fields of the scene."""
    poses = []
    for v, joints in enumerate(joints_m):
        view = CAMERA_PLACEMENTS[v % len(CAMERA_PLACEMENTS)]
        _, R, t = place_camera(view, joints, SIZE)
        rng = np.random.default_rng([seed, _number(name), v])
        poses.append(estimate(joints @ R.T + t, fps, rng)[frames[v]])
    shown = [np.asarray(p)[f] for p, f in zip(phases, frames, strict=True)]
    rates = [fps * len(f) / len(p) for f, p in zip(frames, phases, strict=True)]
    end = max(float(shown[0][-1]), 1.0)
    return SyncScene(name, poses, shown, rates, end, **more)  # type: ignore[arg-type]


def protocol_scene(file: Path, sampling: str, videos: int = 4, seed: int = SEED) -> SyncScene:
    """The paper's protocol: one motion, resampled for each video."""
    captured = protocol_videos(file, sampling, videos)
    return _of_videos(file.stem, captured, seed)


def trial_scene(file: Path, videos: int = 4, seed: int = SEED) -> SyncScene:
    """Several performances; phases by time warping of the true joints, events from the data."""
    captured = trial_videos(file, videos)
    with np.load(file) as stored:
        events = [int(e) for e in stored["event_frame"][: len(captured)]]
    return _of_videos(file.stem, captured, seed, events=events if min(events) >= 0 else None)


def _of_videos(name: str, videos: Sequence[CapturedVideo], seed: int, **more: object) -> SyncScene:
    joints, phases, frames = (
        [getattr(v, f) for v in videos] for f in ("joints_m", "phase", "frames")
    )
    return filmed_scene(name, joints, phases, frames, videos[0].fps, seed=seed, **more)


def _number(name: str) -> int:
    return int.from_bytes(hashlib.sha256(name.encode()).digest()[:4], "big")
