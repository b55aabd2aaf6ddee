"""Scenes made of the training clips: what every choice of the synchronisation was made on.

* `resampled`: one motion, brought to 120 frames/s and resampled as in the paper's protocol;
* `performed`: four performances of a clip, each at its own pace, from its own start to its own end,
  with its own departures;
* `periodic`: windows of a walk that hold different numbers of cycles, each at its own pace.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from benchmarks.actions.captured import RESAMPLED_MAX_RATE
from benchmarks.sync.scenes import SyncScene, seen_by_cameras
from imocap_core.conventions import EVAL_14
from imocap_core.synthetic.captured import hip_middle, to_stage
from imocap_core.synthetic.estimator import EstimatorErrors, estimate
from imocap_core.synthetic.samplings import sample_frames
from imocap_core.synthetic.variation import Clip, pace

Floats = NDArray[np.float64]

CAPTURED_FPS, PROTOCOL_FPS, PROTOCOL_FRAMES = 30.0, 120.0, 2000
RESAMPLED = ("01_01", "02_05", "02_10", "05_18", "13_01", "13_10", "13_15", "13_30")
PERFORMED = (
    *("02_04", "02_09", "03_02", "05_06", "05_13", "05_19", "06_09", "06_12"),
    *("11_01", "13_07", "13_09", "13_33"),
)
PERIODIC = ("02_01", "05_01", "06_01", "07_04", "07_05", "07_12", "12_01", "12_03")
# A performance departs from another by this much, slowly (real ones: 38 to 87 mm).
DEPARTURE = EstimatorErrors(
    joint_m=0.03,
    orientation_rad=0.03,
    depth=1.0,
    joint_persistence_s=0.6,
    orientation_persistence_s=2.0,
)
# Places of EVAL_14's joints in the clips' skeleton.
_NAMES = {
    **{f"{s}_shoulder": f"{s[0]}Shldr" for s in ("left", "right")},
    **{f"{s}_elbow": f"{s[0]}ForeArm" for s in ("left", "right")},
    **{f"{s}_wrist": f"{s[0]}Hand" for s in ("left", "right")},
    **{f"{s}_hip": f"{s[0]}Thigh" for s in ("left", "right")},
    **{f"{s}_knee": f"{s[0]}Shin" for s in ("left", "right")},
    **{f"{s}_ankle": f"{s[0]}Foot" for s in ("left", "right")},
    **{"neck": "neck", "head": "head"},
}


def training_clip(file: Path, clip: str) -> Floats:
    """Joints (T, 14, 3) of a clip on the stage, 30 frames/s, z up."""
    with np.load(file) as stored:
        names = [str(name) for name in stored["names"]]
        joints = stored[f"clip_{clip}"].astype(np.float64)
    joints = joints[:, [names.index(_NAMES[name]) for name in EVAL_14]]
    turn, shift = to_stage(joints)
    placed: Floats = turn.apply(joints.reshape(-1, 3)).reshape(joints.shape) + shift
    return placed


def resampled(file: Path, clip: str, sampling: str, seed: int, videos: int = 4) -> SyncScene:
    """A clip at 120 frames/s, at most 2000 of them, resampled for each video."""
    joints = training_clip(file, clip)
    ratio = PROTOCOL_FPS / CAPTURED_FPS
    at = np.arange(0, len(joints) - 1, 1 / ratio)[:PROTOCOL_FRAMES]
    fine = CubicSpline(np.arange(len(joints)), joints)(at)
    kept = [
        sample_frames(sampling, len(fine), v, np.random.default_rng([seed, v]))
        for v in range(videos)
    ]
    return seen_by_cameras(
        f"{sampling} {clip}",
        [fine] * videos,
        [np.arange(len(fine), dtype=float)] * videos,
        kept,
        PROTOCOL_FPS,
        seed=seed,
        max_rate=RESAMPLED_MAX_RATE,
    )


def performed(
    file: Path, clip: str, seed: int, *, ends: float = 0.08, videos: int = 4, kind: str = ""
) -> SyncScene:
    """Performances of a clip; each shows it from and to its own moment, up to the share `ends`
    inside it."""
    joints = training_clip(file, clip)
    T = len(joints)
    spline = CubicSpline(np.arange(T), joints)
    shown, phases = [], []
    for v in range(videos):
        rng = np.random.default_rng([seed, v, 3])
        first, last = rng.uniform(0, ends) * T, T - 1 - rng.uniform(0, ends) * T
        frames = max(30, round((last - first) * rng.uniform(0.8, 1.25)))
        phase = pace(Clip(frames, first, last, CAPTURED_FPS), rng)
        shown.append(_departed(spline(phase), rng))
        phases.append(phase)
    kept = [np.arange(len(p)) for p in phases]
    return seen_by_cameras(
        f"{kind or 'performed'} {clip}", shown, phases, kept, CAPTURED_FPS, seed=seed
    )


def _departed(joints_m: Floats, rng: np.random.Generator) -> Floats:
    """The same performer's other performance: slow departures, bones kept."""
    middle = hip_middle(joints_m)[:, None]
    departed: Floats = estimate(joints_m, CAPTURED_FPS, rng, DEPARTURE) + middle
    return departed


def training_scenes(file: Path, kind: str, seed: int = 1) -> list[SyncScene]:
    """All scenes of a kind: released, paper, performed or periodic."""
    if kind in ("released", "paper"):
        return [resampled(file, clip, kind, seed) for clip in RESAMPLED]
    if kind == "periodic":
        return [performed(file, clip, seed, ends=0.3, kind=kind) for clip in PERIODIC]
    return [performed(file, clip, seed) for clip in PERFORMED]
