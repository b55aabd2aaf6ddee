"""Scenes for measuring synchronisation alone: poses of a simulated estimator, and the truth.

No file is written and no stage is run: captured motion before four virtual cameras goes through the
simulated monocular estimator straight into `synchronise`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from benchmarks.actions.captured_videos import SIZE, CapturedVideo, protocol_videos, trial_videos
from benchmarks.synthetic.captured import (
    CAMERA_PLACEMENTS,
    hip_middle,
    place_camera,
    sample_frames,
    to_scene,
)
from benchmarks.synthetic.simulated import EstimatorErrors, estimate
from imocap_core.conventions import EVAL_14
from imocap_core.synthetic.choreography import PhaseSpan, pace

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


# Scenes made of the training clips, on which every setting of the synchronisation was chosen.
#
# * `resampled`: one motion, brought to 120 frames/s and resampled as in the paper's protocol;
# * `performed`: four performances of a clip, with pace, start, end and departures of each its own;
# * `periodic`: windows of a walk that show different numbers of cycles, each at its own pace.

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


# Scenes whose detections fail in one video: half of its frames wrong, a leg occluded, another
# person taken for the performer.
#
# Time runs on meanwhile: each frame has its counterpart, and only the other frames tell where.

CHANGED = 2  # the video whose detections fail
SPELL_S = (0.1, 0.6)  # length of a stretch of wrong frames
LEG_ERROR_M = {"knee": 0.12, "ankle": 0.2}
LEG_PERSISTENCE_S = 0.5
OCCLUDED = (0.4, 0.8)  # share of the video
SWAPPED = (0.2, 0.5)


def half_wrong(
    scene: SyncScene, strangers: Float[np.ndarray, "S 14 3"], rng: np.random.Generator
) -> SyncScene:
    """The scene with half of one video's frames wrong: in stretches of a few frames the pose is
    any of `strangers`, turned anyhow."""
    x = scene.poses[CHANGED].copy()
    T, fps = len(x), scene.fps[CHANGED]
    wrong = np.zeros(T, dtype=bool)
    while wrong.mean() < 0.5:
        start, length = int(rng.integers(T)), max(2, round(fps * rng.uniform(*SPELL_S)))
        span = slice(start, min(start + length, T))
        pose = strangers[int(rng.integers(len(strangers)))] @ _turn_about_y(
            rng.uniform(0, 2 * np.pi)
        )
        x[span] = pose + 0.02 * rng.normal(size=x[span].shape)
        wrong[span] = True
    return _with_poses(scene, x)


def leg_occluded(scene: SyncScene, rng: np.random.Generator) -> SyncScene:
    """The scene with one leg unobserved through much of one video: its knee and ankle wander."""
    x = scene.poses[CHANGED].copy()
    T, fps = len(x), scene.fps[CHANGED]
    span = _stretch(T, rng.uniform(*OCCLUDED), rng)
    side = ("left", "right")[int(rng.integers(2))]
    for part, size_m in LEG_ERROR_M.items():
        noise = gaussian_filter1d(
            rng.normal(size=(T, 3)), 0.5 * LEG_PERSISTENCE_S * fps, axis=0, mode="wrap"
        )
        x[span, EVAL_14.index(f"{side}_{part}")] += (size_m * noise / noise.std())[span]
    return _with_poses(scene, x)


def person_swapped(
    scene: SyncScene, other: Float[np.ndarray, "S 14 3"], rng: np.random.Generator
) -> SyncScene:
    """The scene with another person, who does something else, in a stretch of one video."""
    x = scene.poses[CHANGED].copy()
    span = _stretch(len(x), rng.uniform(*SWAPPED), rng)
    length = span.stop - span.start
    first = int(rng.integers(max(1, len(other) - length)))
    x[span] = np.resize(other[first : first + length], x[span].shape)
    return _with_poses(scene, x)


def _stretch(T: int, share: float, rng: np.random.Generator) -> slice:
    length = round(share * T)
    start = int(rng.integers(T - length + 1))
    return slice(start, start + length)


def _turn_about_y(angle: float) -> Float[np.ndarray, "3 3"]:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def _with_poses(scene: SyncScene, x: Float[np.ndarray, "T 14 3"]) -> SyncScene:
    poses = list(scene.poses)
    poses[CHANGED] = x
    return replace(scene, poses=poses)
