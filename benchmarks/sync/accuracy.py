"""Accuracy of the synchronisation alone, by method and warp, and its errors at events.

Poses of the simulated estimator go straight into `synchronise`; no stage is run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import cast

import numpy as np

from benchmarks.sync.calibration import CalibrationRow, calibration, confidences_and_errors
from benchmarks.sync.map_scores import event_errors_frames, pair_error_pct, score_maps
from benchmarks.sync.rivals import RIVALS, rival
from benchmarks.sync.scenes import SyncScene, protocol_scene, trial_scene
from imocap_core.params import SyncParams
from imocap_core.params.sync_params import CycleMethod, Warp
from imocap_core.sync import SyncEvidence, SyncResult, synchronise
from imocap_core.sync.warp.dtw import dtw, positions_of_rows
from imocap_core.sync.warp.template import median_positions

METHODS = ("none", "softmap", "als", "svt")
WARPS = ("posterior", "dtw")


@dataclass(frozen=True)
class AccuracyRow:
    """One clip: errors of the pairwise maps and of the maps to the reference, % of the motion."""

    clip: str
    warp: str
    method: str
    pairwise_pct: float
    sync_pct: float
    frames: float
    matched: float
    within_one_frame: float
    confidence: float


@dataclass(frozen=True)
class EventRow:
    """One action: |event - event of the reference| in frames, over its videos."""

    action: str
    median_frames: float
    largest_frames: float


def accuracy(
    folder: Path, sampling: str, settings: SyncParams, methods: Sequence[str], only: Sequence[str]
) -> list[AccuracyRow]:
    """Every clip with every method and warp (no loop), the rivals, and the means over the clips."""
    rows = []
    for file in sorted(folder.glob("*.npz")):
        if only and file.stem not in only:
            continue
        scene = protocol_scene(file, sampling)
        for warp in WARPS:
            rows += [_accuracy(scene, settings, warp, method) for method in methods]
        reference = _synchronised(scene, settings).reference
        rows += [_rival(scene, kind, reference) for kind in RIVALS]
    return rows + _means(rows)


def calibrated(
    folder: Path, sampling: str, settings: SyncParams, only: Sequence[str]
) -> list[CalibrationRow]:
    """The confidence of the frames of all clips against their errors, with the default settings."""
    pairs = []
    for file in sorted(folder.glob("*.npz")):
        if not only or file.stem in only:
            scene = protocol_scene(file, sampling)
            sync = _synchronised(scene, settings)
            pairs.append(
                confidences_and_errors(scene, sync.reference, sync.reference_frame, sync.confidence)
            )
    return calibration(np.concatenate(pairs), settings.confidence_reach_s) if pairs else []


def _accuracy(scene: SyncScene, settings: SyncParams, warp: str, method: str) -> AccuracyRow:
    choice = replace(settings, warp=cast(Warp, warp), method=cast(CycleMethod, method))
    sync = _synchronised(scene, choice)
    score = score_maps(scene, sync.reference, sync.reference_frame, sync.confidence)
    M = len(scene.poses)
    errors = []
    for i, j in ((i, j) for i in range(M) for j in range(M) if i != j):
        block = sync.relaxed.block(i, j)
        if warp == "dtw":
            positions = positions_of_rows(dtw(-block)[0], len(block))
        else:
            positions = median_positions(block)
        errors.append(pair_error_pct(scene, i, j, positions))
    return AccuracyRow(
        scene.name, warp, method, float(np.mean(errors)), score.error_pct, score.error_frames,
        score.matched, score.within_one, score.confidence,
    )  # fmt: skip


def _rival(scene: SyncScene, kind: str, reference: int) -> AccuracyRow:
    """A rival's maps to the reference; it has none between other videos."""
    frames, confidence = rival(kind, scene, reference)
    score = score_maps(scene, reference, frames, confidence)
    return AccuracyRow(
        scene.name, "-", kind, float("nan"), score.error_pct, score.error_frames,
        score.matched, score.within_one, score.confidence,
    )  # fmt: skip


def _synchronised(scene: SyncScene, settings: SyncParams) -> SyncResult:
    return synchronise(SyncEvidence(scene.poses, scene.fps), settings, np.random.default_rng(0))


def _means(rows: Sequence[AccuracyRow]) -> list[AccuracyRow]:
    """One row for each pair of warp and method: the mean over the clips."""
    means = []
    for warp, method in dict.fromkeys((r.warp, r.method) for r in rows):
        same = [list(asdict(r).values())[3:] for r in rows if (r.warp, r.method) == (warp, method)]
        means.append(AccuracyRow("mean", warp, method, *map(float, np.mean(same, axis=0))))
    return means


def events(folder: Path, settings: SyncParams, only: Sequence[str]) -> list[EventRow]:
    """Every action of the trials whose data give the frame of an event."""
    rows = []
    for file in sorted(folder.glob("*.npz")):
        if only and file.stem not in only:
            continue
        scene = trial_scene(file)
        if scene.events is None:
            continue
        sync = _synchronised(scene, settings)
        errors = event_errors_frames(scene, sync.reference, sync.reference_frame)
        rows.append(EventRow(scene.name, float(np.median(errors)), float(errors.max())))
    return rows
