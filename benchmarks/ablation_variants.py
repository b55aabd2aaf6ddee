"""The paper's ablations as data: each is a switch of pipeline.yaml or another set of inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks import scoring
from benchmarks.actions.captured_videos import DEFAULT_VIDEOS
from benchmarks.tcc import POSES, TccSettings, align_by_tcc, pose_clip
from imocap_core.artifacts.schemas import InitialSmpl, Keypoints, RefineSync, SyncMap
from imocap_core.artifacts.schemas.sync_schemas import SyncSummary
from imocap_core.artifacts.store import Stored
from imocap_core.body.layouts import layout_names
from imocap_core.errors import WrongUse
from imocap_core.evaluate.scoreboard import StageResult, against_truth
from imocap_core.io.truth import Truth
from imocap_core.metrics.scoring import SYNC_METRICS
from imocap_core.pipeline import runner
from imocap_core.pipeline.runner import Display, Job

PAPER_PIPELINE = ("sync.warp=dtw", "motion.objective=paper")


@dataclass(frozen=True)
class VariantRun:
    """Parameters as `--set` takes them, and the inputs."""

    sets: tuple[str, ...] = ()
    videos: int = DEFAULT_VIDEOS
    detector: str = "fine_tuned"
    outlier: bool = False

    def can_run(self, on: str) -> bool:
        """Whether the data allow it: the demo always has four videos, Human3.6M's detections are
        real."""
        simulated = on in ("protocol", "trials")
        fewer = self.videos < DEFAULT_VIDEOS
        return (simulated or (self.detector == "fine_tuned" and not self.outlier)) and not (
            on == "yoga" and fewer
        )

    @property
    def label(self) -> str:
        """The name of the folder of its scores; empty for a run without switches."""
        return "+".join(text.replace(".", "-").replace("=", "-") for text in self.sets)

    @property
    def description(self) -> str:
        """The switches in words."""
        words = [f"`{text}`" for text in self.sets]
        words += [f"`--videos {self.videos}`"] if self.videos != DEFAULT_VIDEOS else []
        words += [f"`--detector {self.detector}`"] if self.detector != "fine_tuned" else []
        words += ["a fifth video, of another action"] if self.outlier else []
        return ", ".join(words) or "pipeline.yaml as it is"


@dataclass(frozen=True)
class PaperErrors:
    """The paper's numbers (Tables 1 to 3, Human3.6M); None where it gives none."""

    mpjpe_mm: float | None = None
    pa_mpjpe_mm: float | None = None
    sync_pct: float | None = None


@dataclass(frozen=True)
class Variant:
    """A row: one result of a run, beside the paper's."""

    name: str
    title: str
    run: VariantRun = field(default_factory=VariantRun)
    result: str = "after loop"
    paper: PaperErrors = field(default_factory=PaperErrors)

    @property
    def switches(self) -> str:
        """How it differs from the default; a rival has no parameters of the pipeline."""
        return "–" if self.is_rival else self.run.description

    @property
    def is_rival(self) -> bool:
        """Whether it only synchronises, on the keypoints of the default run."""
        return self.result in RIVALS


RIVALS = ("tcc", "stretch")
PAPER_4 = PaperErrors(66.53, 50.33, 0.77)

VARIANTS: tuple[Variant, ...] = (
    Variant("estimator", "simulated monocular estimate (HMMR)", result="estimator",
            paper=PaperErrors(109.80, 78.26)),
    Variant("monocular", "each video by itself", result="monocular"),
    Variant("default", "this program", paper=PAPER_4),
    Variant("oracle", "true correspondences and cameras", result="oracle"),
    Variant("no_iteration", "no iteration", result="single pass",
            paper=PaperErrors(71.49, 54.12, 0.91)),
    Variant("no_cycle", "no cycle consistency", VariantRun(("sync.method=none",)),
            paper=PaperErrors(sync_pct=1.19)),
    Variant("paper_softmap", "the paper's pipeline, softmap",
            VariantRun((*PAPER_PIPELINE, "sync.method=softmap")), paper=PAPER_4),
    Variant("paper_als", "the paper's pipeline, ALS",
            VariantRun((*PAPER_PIPELINE, "sync.method=als")), paper=PAPER_4),
    Variant("paper_svt", "the paper's pipeline, SVT",
            VariantRun((*PAPER_PIPELINE, "sync.method=svt")), paper=PAPER_4),
    Variant("paper_none", "the paper's pipeline, no cycle consistency",
            VariantRun((*PAPER_PIPELINE, "sync.method=none")), paper=PaperErrors(sync_pct=1.19)),
    Variant("one_model", "one model for all videos", VariantRun(("motion.objective=single",))),
    *(
        Variant(f"rank_{s}", f"low rank, s = {s}",
                VariantRun(("motion.objective=paper", f"motion.rank={s}")))
        for s in (1, 2, 3)
    ),
    Variant("videos_1", "1 video", VariantRun(videos=1), paper=PaperErrors(80.65, 62.58)),
    Variant("videos_2", "2 videos", VariantRun(videos=2), paper=PaperErrors(78.45, 59.42)),
    Variant("videos_3", "3 videos", VariantRun(videos=3), paper=PaperErrors(71.48, 53.77)),
    Variant("generic", "generic 2D", VariantRun(detector="generic"),
            paper=PaperErrors(76.48, 53.34)),
    Variant("outlier", "with an outlier video", VariantRun(outlier=True)),
    Variant("tcc", "TCC", result="tcc", paper=PaperErrors(sync_pct=11.24)),
    Variant("stretch", "stretched to equal length", result="stretch"),
)  # fmt: skip


def chosen_variants(on: str, names: Sequence[str]) -> tuple[Variant, ...]:
    """The variants to run (all that the data allow when `names` is empty); WrongUse for others."""
    allowed = {v.name: v for v in VARIANTS if v.run.can_run(on)}
    for name in names:
        if name not in allowed:
            raise WrongUse(f"--variants {name}: {on} has {', '.join(allowed)}")
    return tuple(v for v in allowed.values() if not names or v.name in names)


# Rows that only synchronise: TCC, and clips stretched to equal length whatever they show.

TCC_SEEDS = (0, 1, 2)  # runs differ much: the row is the mean of these


def score_rival(
    kind: str, job: Job, display: Display, score_file: Path, costs: Path
) -> scoring.ActionScore:
    """Synchronise with `kind` (tcc or stretch) to the reference that the default run has chosen."""
    meter = scoring.Meter(display, costs)
    done = {o.stage: o.stored for o in runner.run(job, meter, job.pipeline.upstream(scoring.LAST))}
    key = scoring.score_key(job, done, Path(__file__))
    before = scoring.read_score(score_file)
    if before is not None and before.key == key:
        return before
    keypoints = done["keypoints"].decode(Keypoints)
    spent: dict[str, scoring.Cost] = {}
    with meter.measuring(kind, spent):
        syncs = _synchronised(kind, job, keypoints, done)
    truth = scoring.truth_of(job, keypoints)
    rows = [_sync_numbers(sync, done, keypoints, truth) for sync in syncs]
    score = scoring.ActionScore(
        action=job.action.name,
        videos=len(keypoints.videos),
        frames=sum(len(video.frames) for video in keypoints.videos),
        numbers={kind: {name: float(np.mean([row[name] for row in rows])) for name in rows[0]}},
        costs={kind: scoring.Cost(spent[kind].seconds / len(syncs), spent[kind].peak_gb)},
        key=key,
    )
    scoring.write_score(score, score_file)
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
    reference = done[scoring.LAST].decode(RefineSync).sync.reference
    if kind == "stretch":
        return [stretched(keypoints, reference)]
    return [tcc_sync(keypoints, reference=reference, seed=seed) for seed in TCC_SEEDS]


def _sync_numbers(
    sync: SyncSummary, done: dict[str, Stored], keypoints: Keypoints, truth: Truth
) -> dict[str, float]:
    motions = done["initial_smpl"].decode(InitialSmpl).videos
    numbers = against_truth(StageResult("rival", motions, [], sync), keypoints, truth)
    return {name: numbers[name] for name in SYNC_METRICS if name in numbers}


# TCC on an action: keypoints in, the same summary as that of the `sync` stage out.


def tcc_sync(
    keypoints: Keypoints,
    *,
    reference: str,
    seed: int,
    settings: TccSettings = POSES,
    device: str = "cpu",
) -> SyncSummary:
    """Train TCC on an action's clips and align them to the reference video (an id).
    ValueError when a video gives no clip.
    """
    ids = [video.id for video in keypoints.videos]
    if reference not in ids:
        raise ValueError(f"reference: expected one of {', '.join(ids)}, got {reference!r}")
    clips = [
        pose_clip(video.xy_px, video.confidence, hip_columns(video.layout))
        for video in keypoints.videos
    ]
    alignment = align_by_tcc(
        clips,
        [video.fps for video in keypoints.videos],
        settings,
        reference=ids.index(reference),
        seed=seed,
        device=device,
    )
    first, last = alignment.losses[0], alignment.losses[-1]
    return SyncSummary(
        reference=reference,
        ids=ids,
        lengths=[len(clip) for clip in clips],
        maps=[
            SyncMap(id=i, reference_frame=frame, confidence=confidence)
            for i, frame, confidence in zip(
                ids, alignment.reference_frame, alignment.confidence, strict=True
            )
        ],
        method="TCC on poses",
        centrality=np.array([float(i == reference) for i in ids]),
        status=f"{settings.steps} steps, loss {first:.3f} to {last:.3f}",
    )


def hip_columns(layout: str) -> list[int]:
    """The columns of a layout's hips; ValueError when it has none."""
    names = layout_names(layout)
    columns = [names.index(name) for name in ("left_hip", "right_hip") if name in names]
    if not columns:
        raise ValueError(f"layout {layout}: TCC on poses needs the hips, which it does not have")
    return columns
