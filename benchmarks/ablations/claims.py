"""The paper's claims, tested by paired differences over the same actions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from benchmarks.ablations.variants import VARIANTS
from benchmarks.scoring.score_file import ActionScore, first_videos
from benchmarks.tables import PA, SCALED, SYNC, mean_and_error

DECIDED = 2.0  # standard errors that a mean difference must exceed
UNITS = {SCALED: ("scaled MPJPE", "mm", 1), PA: ("P-MPJPE", "mm", 1), SYNC: ("sync error", "%", 2)}
POSE, ALL = (SCALED, PA), (SCALED, PA, SYNC)

VariantScores = Mapping[str, Mapping[str, ActionScore]]  # variant -> action -> score


@dataclass(frozen=True)
class Claim:
    """That one variant has lower errors than another.

    common: the number of first videos that are compared, where one of the two has fewer videos; 0
    for all.
    """

    title: str
    better: str
    worse: str
    metrics: tuple[str, ...]
    common: int = 0


PAPER_CLAIMS = (
    Claim("Two videos are better than one", "videos_2", "videos_1", POSE, common=1),
    Claim("Three videos are better than two", "videos_3", "videos_2", POSE, common=2),
    Claim("Four videos are better than three", "default", "videos_3", POSE, common=3),
    Claim("Several videos are better than a monocular fit", "default", "monocular", POSE),
    Claim("Iteration is better than a single pass", "default", "no_iteration", ALL),
    Claim("Cycle consistency is better than none", "default", "no_cycle", (SYNC,)),
    Claim("Cycle consistency is better than none, paper's pipeline, softmap",
          "paper_softmap", "paper_none", (SYNC,)),
    Claim("Cycle consistency is better than none, paper's pipeline, ALS",
          "paper_als", "paper_none", (SYNC,)),
    Claim("Cycle consistency is better than none, paper's pipeline, SVT",
          "paper_svt", "paper_none", (SYNC,)),
    Claim("Low rank (s = 1) is better than one model", "rank_1", "one_model", POSE),
    Claim("A shared motion with deviations is better than one model", "default", "one_model", POSE),
    Claim("A fine-tuned detector is better than a generic one", "default", "generic", ALL),
    Claim("Pose-based synchronisation is better than TCC", "default", "tcc", (SYNC,)),
)  # fmt: skip
OUR_CLAIMS = (
    Claim("The default is better than the paper's pipeline", "default", "paper_softmap", ALL),
    Claim("Rank 1 is better than rank 2", "rank_1", "rank_2", POSE),
    Claim("Rank 2 is better than rank 3", "rank_2", "rank_3", POSE),
    Claim("No outlier video is better than one", "default", "outlier", ALL),
    Claim("Pose-based synchronisation is better than an equal stretch",
          "default", "stretch", (SYNC,)),
)  # fmt: skip


def differences(claim: Claim, metric: str, scores: VariantScores) -> list[float]:
    """Error of the worse minus error of the better, for each action that both were scored on."""
    result = {v.name: v.result for v in VARIANTS}
    better, worse = scores.get(claim.better, {}), scores.get(claim.worse, {})
    compared = first_videos(claim.common) if claim.common else result[claim.better]
    pairs = [
        (worse[a].of(result[claim.worse], metric), better[a].of(compared, metric))
        for a in better
        if a in worse
    ]
    return [w - b for w, b in pairs if w is not None and b is not None]


def verdict(values: Sequence[float]) -> str:
    """confirmed, refuted, or undecided: whether the mean is 2 standard errors from zero."""
    mean, error = mean_and_error(values)
    if not math.isfinite(error) or abs(mean) <= DECIDED * error:
        return "undecided"
    return "confirmed" if mean > 0 else "refuted"


def sentences(claims: Sequence[Claim], scores: VariantScores) -> list[str]:
    """One sentence for each claim that was measured."""
    lines = []
    for claim in claims:
        parts = [
            _part(metric, values)
            for metric in claim.metrics
            if (values := differences(claim, metric, scores))
        ]
        if parts:
            lines.append(f"{claim.title}: {'; '.join(parts)}.")
    return lines


def _part(metric: str, values: Sequence[float]) -> str:
    name, unit, digits = UNITS[metric]
    mean, error = mean_and_error(values)
    by = f"{mean:+.{digits}f}" + (f" ± {error:.{digits}f}" if math.isfinite(error) else "")
    wins = sum(value > 0 for value in values)
    return f"**{verdict(values)}** in {name} ({by} {unit}, {wins} of {len(values)} actions)"
