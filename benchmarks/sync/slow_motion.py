"""Slow motion and time lapse: one of four videos at another speed, against the same at the usual
one.

The video shows k frames for each one of the plain video (interpolated, at the same frame rate), as
a camera of high frame rate played back at the usual one does; the simulated estimator errs on the
frames that are shown.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.actions.captured import trial_videos
from benchmarks.sync.scenes import SyncScene, filmed_scene
from benchmarks.sync.training_scenes import CAPTURED_FPS
from imocap_core.metrics.sync import matched_share, sync_errors
from imocap_core.params import SyncParams
from imocap_core.sync import SyncEvidence, synchronise

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
    return rows + [_mean([r for r in rows if r.factor == f], f) for f in factors if rows]


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


def _mean(rows: Sequence[SlowMotionRow], factor: float) -> SlowMotionRow:
    """Means over the actions; the ratio is that of the mean errors."""
    numbers = {
        name: float(np.mean([asdict(r)[name] for r in rows]))
        for name in ("error_ms", "matched", "others_ms")
    }
    plain = float(np.mean([r.error_ms / r.ratio for r in rows]))
    return SlowMotionRow("mean", factor, ratio=numbers["error_ms"] / plain, **numbers)
