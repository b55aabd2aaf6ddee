"""Scenes for measuring synchronisation alone: poses as a monocular estimator gives them, and truth.

No file is written and no stage is run: captured motion, seen by four virtual cameras, goes through
the simulated estimator straight into `synchronise`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.actions.captured import RESAMPLED_MAX_RATE, SIZE, Shot, protocol_shots, trial_shots
from imocap_core.synthetic.captured import VIEWPOINTS, place_camera
from imocap_core.synthetic.estimator import estimate

Floats = NDArray[np.float64]
SEED = 11


@dataclass(frozen=True)
class SyncScene:
    """Per video: poses (T, 14, 3) in camera axes, phase (T,) rising, fps; `events` (M,) frames of
    one moment of the action, or None; `max_rate` as `sync.max_rate`, None = the default."""

    name: str
    poses: list[Floats]
    phases: list[Floats]
    fps: list[float]
    phase_end: float
    events: list[int] | None = None
    max_rate: float | None = None

    @property
    def frames(self) -> int:
        """N_a, the frames of all videos."""
        return sum(map(len, self.poses))


def seen_by_cameras(
    name: str,
    joints_m: Sequence[Floats],
    phases: Sequence[Floats],
    kept: Sequence[NDArray[np.int64]],
    fps: float,
    *,
    seed: int = SEED,
    **told: object,
) -> SyncScene:
    """A scene of performances (T_v, 14, 3) on the stage, z up, at `fps`, of which videos keep some
    frames; video v is filmed from viewpoint v."""
    poses = []
    for v, joints in enumerate(joints_m):
        view = VIEWPOINTS[v % len(VIEWPOINTS)]
        _, R, t = place_camera(view, joints, SIZE)
        rng = np.random.default_rng([seed, _number(name), v])
        poses.append(estimate(joints @ R.T + t, fps, rng)[kept[v]])
    own = [np.asarray(p)[k] for p, k in zip(phases, kept, strict=True)]
    rates = [fps * len(k) / len(p) for k, p in zip(kept, phases, strict=True)]
    end = max(float(own[0][-1]), 1.0)
    return SyncScene(name, poses, own, rates, end, **told)  # type: ignore[arg-type]


def protocol_scene(file: Path, sampling: str, videos: int = 4, seed: int = SEED) -> SyncScene:
    """The paper's protocol: one motion, resampled for each video."""
    shots = protocol_shots(file, sampling, videos)
    return _of_shots(file.stem, shots, seed, max_rate=RESAMPLED_MAX_RATE)


def trial_scene(file: Path, videos: int = 4, seed: int = SEED) -> SyncScene:
    """Several performances; phases by time warping of true joints, events as the data tell them."""
    shots = trial_shots(file, videos)
    with np.load(file) as stored:
        events = [int(e) for e in stored["event_frame"][: len(shots)]]
    return _of_shots(file.stem, shots, seed, events=events if min(events) >= 0 else None)


def _of_shots(name: str, shots: Sequence[Shot], seed: int, **told: object) -> SyncScene:
    joints, phases, kept = ([getattr(s, f) for s in shots] for f in ("joints_m", "phase", "kept"))
    return seen_by_cameras(name, joints, phases, kept, shots[0].fps, seed=seed, **told)


def _number(name: str) -> int:
    return int.from_bytes(hashlib.sha256(name.encode()).digest()[:4], "big")
