"""Freeze frames: one of four videos stands still for a second because it was paused, and holds its
last picture for another, against the same video without that.

`identical`: the estimator errs once for a picture. `re-coded`: the pictures differ a little, as
after a lossy codec; a detector's points then move as those of a person who stands still (measured
on a re-coded freeze of *balance_beam*: 0.2 % of the height from frame to frame).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.actions.captured import video_rng
from benchmarks.sync.scenes import SyncScene, trial_scene
from imocap_core.metrics.sync import sync_errors
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
    return rows + [_mean([r for r in rows if r.kind == kind], kind) for kind in KINDS if rows]


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


def _mean(rows: Sequence[FreezeRow], kind: str) -> FreezeRow:
    fields = [name for name in asdict(rows[0]) if name not in ("action", "kind")]
    means = {name: float(np.nanmean([asdict(r)[name] for r in rows])) for name in fields}
    return FreezeRow("mean", kind, **means)
