"""Scenes made of the training clips, on which every setting of the synchronisation was chosen.

* `resampled`: one motion, brought to 120 frames/s and resampled as in the paper's protocol;
* `performed`: four performances of a clip, with pace, start, end and departures of each its own;
* `periodic`: windows of a walk that show different numbers of cycles, each at its own pace.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

from benchmarks.sync.scenes import SyncScene, filmed_scene
from benchmarks.synthetic.captured import hip_middle, to_scene
from benchmarks.synthetic.estimator import EstimatorErrors, estimate
from benchmarks.synthetic.frame_sampling import sample_frames
from imocap_core.conventions import EVAL_14
from imocap_core.synthetic.choreography import PhaseSpan, pace

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


def training_clip(file: Path, clip: str) -> Float[np.ndarray, "T 14 3"]:
    """Joints of a clip on the stage, 30 frames/s, metres, z up."""
    with np.load(file) as stored:
        names = [str(name) for name in stored["names"]]
        joints = stored[f"clip_{clip}"].astype(np.float64)
    joints = joints[:, [names.index(_NAMES[name]) for name in EVAL_14]]
    turn, shift = to_scene(joints)
    placed: Float[np.ndarray, "T 14 3"] = (
        turn.apply(joints.reshape(-1, 3)).reshape(joints.shape) + shift
    )
    return placed


def resampled(file: Path, clip: str, sampling: str, seed: int, videos: int = 4) -> SyncScene:
    """A clip at 120 frames/s, at most 2000 of them, resampled for each video."""
    joints = training_clip(file, clip)
    ratio = PROTOCOL_FPS / CAPTURED_FPS
    times = np.arange(0, len(joints) - 1, 1 / ratio)[:PROTOCOL_FRAMES]
    fine = CubicSpline(np.arange(len(joints)), joints)(times)
    frames = [
        sample_frames(sampling, len(fine), v, np.random.default_rng([seed, v]))
        for v in range(videos)
    ]
    return filmed_scene(
        f"{sampling} {clip}",
        [fine] * videos,
        [np.arange(len(fine), dtype=float)] * videos,
        frames,
        PROTOCOL_FPS,
        seed=seed,
    )


def performed(
    file: Path, clip: str, seed: int, *, ends: float = 0.08, videos: int = 4, kind: str = ""
) -> SyncScene:
    """Performances of a clip; each starts and ends at its own moment, at most the share `ends` of
    the clip from its start and end."""
    shown, phases = performances(file, clip, seed, ends=ends, videos=videos)
    frames = [np.arange(len(p)) for p in phases]
    return filmed_scene(
        f"{kind or 'performed'} {clip}", shown, phases, frames, CAPTURED_FPS, seed=seed
    )


def performances(
    file: Path, clip: str, seed: int, *, ends: float = 0.08, videos: int = 4
) -> tuple[list[Float[np.ndarray, "_T 14 3"]], list[Float[np.ndarray, "_T"]]]:
    """Joints on the stage and phases of the performances of a clip."""
    return performances_of(training_clip(file, clip), seed, ends=ends, videos=videos)


def performances_of(
    joints: Float[np.ndarray, "T 14 3"], seed: int, *, ends: float = 0.08, videos: int = 4
) -> tuple[list[Float[np.ndarray, "_T 14 3"]], list[Float[np.ndarray, "_T"]]]:
    """Performances of a motion on the stage, and their phases."""
    T = len(joints)
    spline = CubicSpline(np.arange(T), joints)
    shown, phases = [], []
    for v in range(videos):
        rng = np.random.default_rng([seed, v, 3])
        first, last = rng.uniform(0, ends) * T, T - 1 - rng.uniform(0, ends) * T
        count = max(30, round((last - first) * rng.uniform(0.8, 1.25)))
        phase = pace(PhaseSpan(count, first, last, CAPTURED_FPS), rng)
        shown.append(_departed(spline(phase), rng))
        phases.append(phase)
    return shown, phases


def _departed(joints_m: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Another performance of the same performer: slow departures at constant bone lengths."""
    middle = hip_middle(joints_m)[:, None]
    return np.asarray(estimate(joints_m, CAPTURED_FPS, rng, DEPARTURE) + middle)


def training_scenes(file: Path, kind: str, seed: int = 1) -> list[SyncScene]:
    """All scenes of a kind: released, paper, performed or periodic."""
    if kind in ("released", "paper"):
        return [resampled(file, clip, kind, seed) for clip in RESAMPLED]
    if kind == "periodic":
        return [performed(file, clip, seed, ends=0.3, kind=kind) for clip in PERIODIC]
    return [performed(file, clip, seed) for clip in PERFORMED]
