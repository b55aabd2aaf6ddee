"""`imocap benchmark sync`: synchronisation alone, its accuracy by method and warp, events, speed.

Poses of the simulated estimator go straight into `synchronise`; no stage is run.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from imocap_core.sync import Settings, SyncResult, synchronise
from imocap_core.sync.blocks import Blocks
from imocap_core.sync.dtw import dtw, positions_of_rows
from imocap_core.sync.warping import median_positions
from stages.benchmarks.sync_scenes import SyncScene, protocol_scene, trial_scene
from stages.benchmarks.sync_score import event_errors_frames, pair_error_pct, score_maps

METHODS = ("none", "softmap", "als", "svt", "auto")
WARPS = ("posterior", "dtw")


@dataclass(frozen=True)
class AccuracyRow:
    """One clip: error in % of the pairwise maps and of the maps to the reference."""

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
    """One action: |event - event of the reference| in frames."""

    action: str
    median_frames: float
    largest_frames: float


def accuracy(
    folder: Path, sampling: str, settings: Settings, methods: Sequence[str], only: Sequence[str]
) -> list[AccuracyRow]:
    """Every clip with every method and warp, before the loop, and the means."""
    rows = []
    for file in sorted(folder.glob("*.npz")):
        if only and file.stem not in only:
            continue
        scene = protocol_scene(file, sampling)
        for warp in WARPS:
            rows += [_accuracy(scene, settings, warp, method) for method in methods]
    return rows + _means(rows, methods)


def _accuracy(scene: SyncScene, settings: Settings, warp: str, method: str) -> AccuracyRow:
    chosen = replace(settings, warp=warp, method=method)
    if scene.max_rate is not None:
        chosen = replace(chosen, max_rate=scene.max_rate)
    found = _synchronised(scene, chosen)
    score = score_maps(scene, found.reference, found.reference_frame, found.confidence)
    blocks, M = Blocks(tuple(map(len, scene.poses))), len(scene.poses)
    errors = []
    for i, j in ((i, j) for i in range(M) for j in range(M) if i != j):
        block = np.asarray(blocks.block(found.relaxed, i, j), dtype=float)
        if warp == "dtw":
            at = positions_of_rows(dtw(-block)[0], len(block))
        else:
            at = median_positions(block)
        errors.append(pair_error_pct(scene, i, j, at))
    return AccuracyRow(
        scene.name, warp, method, float(np.mean(errors)), score.error_pct, score.error_frames,
        score.matched, score.within_one, score.confidence,
    )  # fmt: skip


def _synchronised(scene: SyncScene, settings: Settings) -> SyncResult:
    return synchronise(scene.poses, fps=scene.fps, settings=settings, rng=np.random.default_rng(0))


def _means(rows: Sequence[AccuracyRow], methods: Sequence[str]) -> list[AccuracyRow]:
    means = []
    for warp in WARPS:
        for method in methods:
            same = [
                list(asdict(r).values())[3:] for r in rows if (r.warp, r.method) == (warp, method)
            ]
            if same:
                means.append(AccuracyRow("mean", warp, method, *map(float, np.mean(same, axis=0))))
    return means


def events(folder: Path, settings: Settings, only: Sequence[str]) -> list[EventRow]:
    """Every action of the trials whose data name an event."""
    rows = []
    for file in sorted(folder.glob("*.npz")):
        if only and file.stem not in only:
            continue
        scene = trial_scene(file)
        if scene.events is None:
            continue
        found = _synchronised(scene, settings)
        errors = event_errors_frames(scene, found.reference, found.reference_frame)
        rows.append(EventRow(scene.name, float(np.median(errors)), float(errors.max())))
    return rows


def markdown(rows: Sequence[Any]) -> str:
    """A column a field, two decimals."""
    told = [asdict(row) for row in rows]
    lines = [list(told[0]), ["---"] * len(told[0])]
    lines += [[f"{v:.2f}" if isinstance(v, float) else str(v) for v in t.values()] for t in told]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def write_tables(folder: Path, name: str, rows: Sequence[Any]) -> None:
    """`name`.md, .csv and .json in `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    told = [asdict(row) for row in rows]
    (folder / f"{name}.md").write_text(markdown(rows) + "\n")
    out = io.StringIO()
    writer = csv.DictWriter(out, list(told[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(told)
    (folder / f"{name}.csv").write_text(out.getvalue())
    plain = [{k: None if v in (float("inf"),) else v for k, v in t.items()} for t in told]
    (folder / f"{name}.json").write_text(json.dumps(plain, indent=1) + "\n")
