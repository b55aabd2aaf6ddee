"""The paper's ablations as data: each is a switch of pipeline.yaml or another set of inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from benchmarks.actions.captured import DEFAULT_VIDEOS
from imocap_core.errors import WrongUse

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
