"""Freeze frames: one of four videos stands still for a second because it was paused, and holds its
last picture for another, against the same video without that.

`identical`: the estimator errs once for a picture. `re-coded`: the pictures differ a little, as
after a lossy codec; a detector's points then move as those of a person who stands still (measured
on a re-coded freeze of *balance_beam*: 0.2 % of the height from frame to frame).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.actions.captured_videos import trial_videos, video_rng
from benchmarks.sync_scenes import CAPTURED_FPS, SyncScene, filmed_scene, trial_scene
from imocap_core.metrics.sync import matched_share, sync_errors
from imocap_core.params import SyncParams
from imocap_core.sync import SyncEvidence, SyncResult, synchronise

FROZEN = 1  # the video
FREEZE_S = 1.0
RECODED_M = 0.003
KINDS = ("plain", "identical", "re-coded")


@dataclass(frozen=True)
class FreezeRow:
    """One action: errors in ms of the action of the video's frames.

    Attributes:
        moving_ms: of the frames that are shown once; frozen_ms: of the frozen ones.
        spread_ms: of the moments that the frames of one picture are matched to.
        confidence: of the moving frames; frozen_confidence: of the frozen ones, mean.
    """

    action: str
    kind: str
    moving_ms: float
    frozen_ms: float
    spread_ms: float
    confidence: float
    frozen_confidence: float


def freeze_frames(
    folder: Path, settings: SyncParams, only: Sequence[str], seed: int = 11
) -> list[FreezeRow]:
    """All captured trials, and the means over the actions."""
    files = [f for f in sorted(folder.glob("*.npz")) if not only or f.stem in only]
    return freeze_rows([trial_scene(f, seed=seed) for f in files], settings)


def freeze_rows(scenes: Sequence[SyncScene], settings: SyncParams) -> list[FreezeRow]:
    """One row for each scene and kind, and the means of each kind."""
    rows = [_row(scene, kind, settings) for scene in scenes for kind in KINDS]
    return rows + [
        _mean_of_kind([r for r in rows if r.kind == kind], kind) for kind in KINDS if rows
    ]


def frozen_scene(scene: SyncScene, kind: str) -> tuple[SyncScene, np.ndarray]:
    """The scene with freeze frames in video FROZEN, and which of its frames are frozen."""
    rng = video_rng(scene.name, FROZEN, 9)
    T, fps = len(scene.phases[FROZEN]), scene.fps[FROZEN]
    paused = int(rng.integers(T // 4, 3 * T // 4))
    count = round(FREEZE_S * fps)
    again = np.zeros(T, dtype=int)
    again[[paused, T - 1]] = count - 1
    shown = np.repeat(np.arange(T), again + 1)
    frozen = (again > 0)[shown]
    if kind == "plain":
        return scene, (again > 0)
    poses, phases = list(scene.poses), list(scene.phases)
    poses[FROZEN], phases[FROZEN] = poses[FROZEN][shown], phases[FROZEN][shown]
    if kind == "re-coded":
        noise = RECODED_M * rng.normal(size=poses[FROZEN].shape)
        poses[FROZEN] = poses[FROZEN] + np.where(frozen[:, None, None], noise, 0.0)
    return replace(scene, poses=poses, phases=phases), frozen


def _row(plain: SyncScene, kind: str, settings: SyncParams) -> FreezeRow:
    scene, frozen = frozen_scene(plain, kind)
    eligible = next(v for v in range(len(scene.poses)) if v != FROZEN)
    evidence = SyncEvidence(scene.poses, scene.fps, reference=eligible)
    sync = synchronise(evidence, settings, np.random.default_rng(0))
    error_ms, moment_ms = _of_video(scene, sync)
    confidence = sync.confidence[FROZEN]
    runs = np.split(np.arange(len(frozen)), np.flatnonzero(np.diff(frozen.astype(int))) + 1)
    spreads = [np.ptp(moment_ms[r]) for r in runs if frozen[r[0]]]
    return FreezeRow(
        plain.name,
        kind,
        float(np.nanmean(error_ms[~frozen])),
        float(np.nanmean(error_ms[frozen])),
        float(np.nanmean(spreads)),
        float(confidence[~frozen].mean()),
        float(confidence[frozen].mean()),
    )


def _of_video(scene: SyncScene, sync: SyncResult) -> tuple[np.ndarray, np.ndarray]:
    """Errors and matched moments (T,) of video FROZEN, ms of the reference."""
    r, frames = sync.reference, sync.reference_frame[FROZEN]
    reference = np.arange(float(len(scene.phases[r])))
    errors = sync_errors(frames, scene.phases[FROZEN], reference, scene.phases[r], scene.phase_end)
    ms = 1000.0 / scene.fps[r]
    return ms * errors.frames, ms * frames


def _mean_of_kind(rows: Sequence[FreezeRow], kind: str) -> FreezeRow:
    fields = [name for name in asdict(rows[0]) if name not in ("action", "kind")]
    means = {name: float(np.nanmean([asdict(r)[name] for r in rows])) for name in fields}
    return FreezeRow("mean", kind, **means)


# Slow motion and time lapse: one of four videos at another speed, against the same at the usual
# one.
#
# The video shows k frames for each one of the plain video (interpolated, at the same frame rate),
# as a camera of high frame rate played back at the usual one does; the simulated estimator errs on
# the frames that are shown.

FACTORS = (1.0, 2.0, 4.0, 8.0)
SLOWED = 1  # the video whose speed changes
SEEDS = (11, 12, 13)  # draws of the estimator: single ratios scatter by a factor of 1.5

Shown = tuple[list[np.ndarray], list[np.ndarray]]  # per video joints (T, 14, 3) and phases (T,)


@dataclass(frozen=True)
class SlowMotionRow:
    """One action with one video slower by a factor: the errors in the action's time.

    Attributes:
        error_ms: of the video; ratio: to its error at the usual speed.
        matched: share of its frames with a counterpart that are matched.
        others_ms: error of the other videos.
    """

    action: str
    factor: float
    error_ms: float
    ratio: float
    matched: float
    others_ms: float


def slow_motion(
    folder: Path, settings: SyncParams, factors: Sequence[float], only: Sequence[str]
) -> list[SlowMotionRow]:
    """All captured trials, and the means over the actions."""
    files = [f for f in sorted(folder.glob("*.npz")) if not only or f.stem in only]
    made = {f.stem: _shown_of_trials(f) for f in files}
    return slow_motion_rows(made, settings, factors)


def slow_motion_rows(
    made: dict[str, Shown],
    settings: SyncParams,
    factors: Sequence[float],
    report: Callable[[SlowMotionRow], None] = lambda row: None,
    seeds: Sequence[int] = SEEDS,
) -> list[SlowMotionRow]:
    """One row for each action and factor, means over draws of the estimator, and the means of each
    factor."""
    rows: list[SlowMotionRow] = []
    for action, shown in made.items():
        plain = float("nan")
        for factor in factors:
            scenes = [slowed_scene(action, shown, factor, seed) for seed in seeds]
            draws = [_errors(scene, settings) for scene in scenes]
            error, matched, others = (float(x) for x in np.mean(draws, axis=0))
            plain = error if factor == 1 else plain
            rows.append(SlowMotionRow(action, factor, error, error / plain, matched, others))
            report(rows[-1])
    return rows + [_mean_of_factor([r for r in rows if r.factor == f], f) for f in factors if rows]


def slowed_scene(action: str, shown: Shown, factor: float, seed: int = 11) -> SyncScene:
    """The scene in which video SLOWED shows `factor` frames for each one."""
    joints, phases = list(shown[0]), list(shown[1])
    T = len(phases[SLOWED])
    times = np.arange(0.0, T - 1 + 1e-9, 1.0 / factor)
    joints[SLOWED] = CubicSpline(np.arange(T), joints[SLOWED])(times)
    phases[SLOWED] = np.interp(times, np.arange(T), phases[SLOWED])
    frames = [np.arange(len(p)) for p in phases]
    return filmed_scene(action, joints, phases, frames, CAPTURED_FPS, seed=seed)


def _shown_of_trials(file: Path) -> Shown:
    videos = trial_videos(file, 4)
    return [v.joints_m for v in videos], [v.phase for v in videos]


def _errors(scene: SyncScene, settings: SyncParams) -> tuple[float, float, float]:
    """Of the video: mean error, ms of the action, and matched share; error of the others."""
    sync = synchronise(SyncEvidence(scene.poses, scene.fps), settings, np.random.default_rng(0))
    r, error_ms, matched = sync.reference, {}, {}
    for v, frames in enumerate(sync.reference_frame):
        if v == r:
            continue
        reference = np.arange(float(len(scene.phases[r])))
        errors = sync_errors(frames, scene.phases[v], reference, scene.phases[r], scene.phase_end)
        both = errors.matched & errors.has_truth
        ms = 1000.0 / CAPTURED_FPS * scene.phase_end * errors.phase[both]
        error_ms[v] = float(ms.mean()) if both.any() else float("nan")
        matched[v] = matched_share(errors)
    # where it is the reference itself, its errors are those of the maps that lead to it
    of_video = [SLOWED] if SLOWED in error_ms else list(error_ms)
    others = [v for v in error_ms if v != SLOWED]
    return (
        float(np.mean([error_ms[v] for v in of_video])),
        float(np.mean([matched[v] for v in of_video])),
        float(np.mean([error_ms[v] for v in others])),
    )


def _mean_of_factor(rows: Sequence[SlowMotionRow], factor: float) -> SlowMotionRow:
    """Means over the actions; the ratio is that of the mean errors."""
    numbers = {
        name: float(np.mean([asdict(r)[name] for r in rows]))
        for name in ("error_ms", "matched", "others_ms")
    }
    plain = float(np.mean([r.error_ms / r.ratio for r in rows]))
    return SlowMotionRow("mean", factor, ratio=numbers["error_ms"] / plain, **numbers)
