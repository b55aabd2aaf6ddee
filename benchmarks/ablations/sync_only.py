"""Rows that only synchronise: TCC, and clips stretched to equal length whatever they show."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.ablations.tcc_sync import tcc_sync
from benchmarks.scoring.costs import Cost, Meter
from benchmarks.scoring.score import score_key, truth_of
from benchmarks.scoring.score_file import LAST, ActionScore, read_score, write_score
from imocap_core.artifacts.schemas import InitialSmpl, Keypoints, RefineSync, SyncMap
from imocap_core.artifacts.schemas.sync_schemas import SyncSummary
from imocap_core.artifacts.store import Stored
from imocap_core.evaluate.scoreboard import StageResult, against_truth
from imocap_core.io.truth import Truth
from imocap_core.metrics.scoring import SYNC_METRICS
from imocap_core.pipeline import runner
from imocap_core.pipeline.runner import Display, Job

TCC_SEEDS = (0, 1, 2)  # runs differ much: the row is the mean of these


def score_rival(
    kind: str, job: Job, display: Display, score_file: Path, costs: Path
) -> ActionScore:
    """Synchronise with `kind` (tcc or stretch) to the reference that the default run has chosen."""
    meter = Meter(display, costs)
    done = {o.stage: o.stored for o in runner.run(job, meter, job.pipeline.upstream(LAST))}
    key = score_key(job, done, Path(__file__))
    before = read_score(score_file)
    if before is not None and before.key == key:
        return before
    keypoints = done["keypoints"].decode(Keypoints)
    spent: dict[str, Cost] = {}
    with meter.measuring(kind, spent):
        syncs = _synchronised(kind, job, keypoints, done)
    truth = truth_of(job, keypoints)
    rows = [_sync_numbers(sync, done, keypoints, truth) for sync in syncs]
    score = ActionScore(
        action=job.action.name,
        videos=len(keypoints.videos),
        frames=sum(len(video.frames) for video in keypoints.videos),
        numbers={kind: {name: float(np.mean([row[name] for row in rows])) for name in rows[0]}},
        costs={kind: Cost(spent[kind].seconds / len(syncs), spent[kind].peak_gb)},
        key=key,
    )
    write_score(score, score_file)
    return score


def stretched(keypoints: Keypoints, reference: str) -> SyncSummary:
    """Every video from the reference's first frame to its last, at an even rate."""
    lengths = {video.id: len(video.frames) for video in keypoints.videos}
    last = float(lengths[reference] - 1)
    maps = [
        SyncMap(id=i, reference_frame=np.linspace(0.0, last, n), confidence=np.ones(n))
        for i, n in lengths.items()
    ]
    return SyncSummary(
        reference=reference,
        ids=list(lengths),
        lengths=list(lengths.values()),
        maps=maps,
        method="equal stretch",
        centrality=np.array([float(i == reference) for i in lengths]),
        status="nothing looked at",
    )


def _synchronised(
    kind: str, job: Job, keypoints: Keypoints, done: dict[str, Stored]
) -> list[SyncSummary]:
    reference = done[LAST].decode(RefineSync).sync.reference
    if kind == "stretch":
        return [stretched(keypoints, reference)]
    return [tcc_sync(keypoints, reference=reference, seed=seed) for seed in TCC_SEEDS]


def _sync_numbers(
    sync: SyncSummary, done: dict[str, Stored], keypoints: Keypoints, truth: Truth
) -> dict[str, float]:
    motions = done["initial_smpl"].decode(InitialSmpl).videos
    numbers = against_truth(StageResult("rival", motions, [], sync), keypoints, truth)
    return {name: numbers[name] for name in SYNC_METRICS if name in numbers}
