"""The table of `imocap benchmark degraded`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from benchmarks.degraded.footage import Footage
from benchmarks.stability import pair_errors
from benchmarks.stability.tables import VariantScore
from benchmarks.tables import ABSENT, PA, SCALED, SYNC, cell, markdown_table, missing_sentence

COLUMNS = (
    (SCALED, 1, "MPJPE, scaled (mm)"),
    (PA, 1, "P-MPJPE (mm)"),
    (SYNC, 2, "sync %"),
    (pair_errors.FRAMES, 2, "sync, frames"),
    (pair_errors.CAMERA, 2, "cameras °"),
)


@dataclass(frozen=True)
class DegradedScore:
    """The result of one footage of an action.

    contradicted: doubtful joints, detected where the other videos do not have them, which were
    looked at again. moved: joints that took another place.
    """

    action: str
    footage: Footage
    result: VariantScore
    contradicted: int = 0
    moved: int = 0


def markdown(
    scores: Sequence[DegradedScore], missing: Sequence[str] = (), absent: Sequence[str] = ()
) -> str:
    """The whole report. missing: names of what was not run; absent: why actions have no data."""
    head = ("action", "footage", "videos degraded", *(heading for *_, heading in COLUMNS))
    more = ("left out or mirrored", "joints looked at again", "joints moved")
    parts = [
        "# The pipeline on degraded footage",
        "Made by `imocap benchmark degraded`. Every action runs at the defaults, from pixels; "
        "numbers are those after the loop: MPJPE and sync % means over the videos, the "
        "other sync and cameras means over all pairs of videos." + missing_sentence(missing),
        markdown_table((*head, *more), [_row(score) for score in scores]),
    ]
    if absent:
        parts.append("**Not measured:**\n\n" + "\n".join(f"* {reason}" for reason in absent))
    return "\n\n".join(parts) + "\n"


def _row(score: DegradedScore) -> list[str]:
    result = score.result
    counts = (score.contradicted, score.moved)
    return [
        score.action,
        f"{result.title}: {result.fault}" if result.fault else result.title,
        score.footage.extent,
        *(cell(result.of(metric), digits) for metric, digits, _ in COLUMNS),
        ABSENT if result.fault else _screened(result),
        *(ABSENT if result.fault else str(count) for count in counts),
    ]


def _screened(result: VariantScore) -> str:
    videos = [f"{video} left out" for video in result.excluded]
    videos += [f"{video} mirrored" for video in result.mirrored]
    return ", ".join(videos) or "none"
