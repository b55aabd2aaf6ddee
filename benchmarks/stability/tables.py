"""The tables of `imocap benchmark stability`: how far harmless perturbations move a result."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from benchmarks.stability import pair_errors
from benchmarks.tables import CAMERA, DETAILS, PA, SCALED, cell, markdown_table

MPJPE, FRAMES = "mpjpe_mm", "sync_error_frames"
COLUMNS = (
    (MPJPE, 1, "MPJPE (mm)"),
    (SCALED, 1, "scaled"),
    (PA, 1, "P-MPJPE"),
    (pair_errors.CAMERA, 2, "cameras °"),
    (pair_errors.FRAMES, 2, "sync, frames"),
    (CAMERA, 2, "cameras to the reference °"),
    (FRAMES, 2, "sync to the reference, frames"),
)
LIMIT_PCT, LIMIT_DEG, LIMIT_FRAMES = 10.0, 1.0, 0.2


@dataclass(frozen=True)
class VariantScore:
    """The result of one perturbed action: metric -> mean over its videos, empty where it failed."""

    title: str
    numbers: dict[str, float]
    reference: str = ""
    excluded: tuple[str, ...] = ()
    mirrored: tuple[str, ...] = ()
    fault: str = ""

    def of(self, metric: str) -> float:
        """One number; NaN where it could not be scored."""
        return self.numbers.get(metric, math.nan)


@dataclass
class ActionStability:
    """Results of one action, first the undisturbed one. not_measured: why there are none."""

    name: str
    scores: list[VariantScore] = field(default_factory=list)
    not_measured: str = ""


@dataclass(frozen=True)
class Movement:
    """How far the results of one action lie apart.

    worst_pct: highest MPJPE over the median, in % of it. camera_deg, sync_frames: largest distance
    from the median. screening_differs: other videos are excluded or mirrored than undisturbed.
    """

    undisturbed_mm: float
    median_mm: float
    worst_mm: float
    worst_pct: float
    camera_deg: float
    sync_frames: float
    screening_differs: int
    faults: int

    @property
    def broken_limits(self) -> list[str]:
        """What keeps the action from being stable; a number that is missing keeps it too."""
        limits = (
            ("MPJPE", self.worst_pct, LIMIT_PCT),
            ("cameras", self.camera_deg, LIMIT_DEG),
            ("sync", self.sync_frames, LIMIT_FRAMES),
        )
        broken = [name for name, value, limit in limits if not value <= limit]
        return broken + ["a run failed"] * (self.faults > 0)


def movement(scores: Sequence[VariantScore]) -> Movement:
    """How far the results of one action's variants lie apart; the first is the undisturbed one."""
    mm = np.array([score.of(MPJPE) for score in scores if not score.fault])
    median = float(np.median(mm)) if len(mm) else math.nan
    worst = float(np.max(mm)) if len(mm) else math.nan
    screened = {(frozenset(s.excluded), frozenset(s.mirrored)) for s in scores[:1]}
    differing = [
        s for s in scores if (frozenset(s.excluded), frozenset(s.mirrored)) not in screened
    ]
    return Movement(
        scores[0].of(MPJPE),
        median,
        worst,
        100.0 * (worst / median - 1.0),
        _farthest(scores, pair_errors.CAMERA),
        _farthest(scores, pair_errors.FRAMES),
        len([s for s in differing if not s.fault]),
        sum(bool(score.fault) for score in scores),
    )


def markdown(actions: Sequence[ActionStability]) -> str:
    """The whole report."""
    measured = [action for action in actions if action.scores]
    parts = [
        "# Stability: harmless perturbations",
        "Made by `imocap benchmark stability`. Every variant runs at the defaults; numbers are "
        "those after the loop, means over its videos. *worst* is the highest MPJPE, cameras and "
        "sync the largest distance from the median; their errors are means over all pairs of "
        "videos, as variants may differ in the reference. Limits: "
        f"{LIMIT_PCT:.0f} % of the median, "
        f"{LIMIT_DEG:.0f}°, {LIMIT_FRAMES:.1f} frames.",
        _movements(measured),
    ]
    missing = [action for action in actions if not action.scores]
    if missing:
        lines = [f"* {action.name}: {action.not_measured}" for action in missing]
        parts.append("**Not measured:**\n\n" + "\n".join(lines))
    parts.append(DETAILS)
    for action in measured:
        parts += [f"## {action.name}", _variants(action.scores)]
    return "\n\n".join(parts) + "\n"


def _movements(actions: Sequence[ActionStability]) -> str:
    rows = []
    for action in actions:
        moved = movement(action.scores)
        values = (moved.undisturbed_mm, moved.median_mm, moved.worst_mm, moved.worst_pct)
        rows.append(
            [
                action.name,
                str(len(action.scores)),
                *(cell(value, 1) for value in values),
                cell(moved.camera_deg, 2),
                cell(moved.sync_frames, 2),
                str(moved.screening_differs),
                "no: " + ", ".join(moved.broken_limits) if moved.broken_limits else "yes",
            ]
        )
    head = ["action", "runs", "undisturbed (mm)", "median", "worst", "over the median %"]
    return markdown_table(
        [*head, "cameras °", "sync, frames", "other videos excluded or mirrored", "stable"], rows
    )


def _variants(scores: Sequence[VariantScore]) -> str:
    rows = [
        [
            f"{score.title}: {score.fault}" if score.fault else score.title,
            *(cell(score.of(metric), digits) for metric, digits, _ in COLUMNS),
            score.reference,
            ", ".join(score.excluded) or "none",
            ", ".join(score.mirrored) or "none",
        ]
        for score in scores
    ]
    head = ["perturbation", *(heading for *_, heading in COLUMNS)]
    return markdown_table([*head, "reference", "excluded", "mirrored"], rows)


def _farthest(scores: Sequence[VariantScore], metric: str) -> float:
    """Largest distance of a metric from its median; NaN where a run has no such number."""
    values = np.array([score.of(metric) for score in scores if not score.fault])
    return float(np.abs(values - np.median(values)).max()) if len(values) else math.nan
