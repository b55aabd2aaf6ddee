"""The actions of a working folder, and the state of each."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from imocap_core.errors import ImocapError
from imocap_core.library.door import plain_errors
from imocap_core.pipeline import runner
from imocap_core.pipeline.builtin_actions import BUILT_IN
from imocap_core.workspace import Workspace

State = Literal["cached", "partly cached", "not run", "not made", "invalid"]
HEADLINE = (  # column of report/summary.csv, and its text
    ("mpjpe_scaled_mm", "scaled MPJPE {:.1f} mm"),
    ("sync_error_pct", "sync error {:.2f} %"),
    ("camera_rotation_error_deg", "cameras {:.1f} deg"),
    ("matched_share", "matched {:.0%}"),
    ("reprojection_px", "reprojection {:.1f} px"),
)
HEADLINE_PARTS = 3


@dataclass(frozen=True)
class ActionSummary:
    """One action.

    state: whether its stages are cached ("not made": built in, made by its first run). videos:
    their number; None unless action.yaml can be read. stages, cached: numbers of stages. headline:
    the figures of its last report. fault: why action.yaml is invalid.
    """

    name: str
    state: State
    videos: int | None = None
    stages: int = 0
    cached: int = 0
    headline: str = ""
    fault: str = ""


@plain_errors
def list_actions(root: str | Path = ".") -> list[ActionSummary]:
    """The actions below root/actions and the built-in ones, by name."""
    workspace = Workspace(Path(root))
    names = {file.parent.name for file in (workspace.root / "actions").glob("*/action.yaml")}
    return [
        _summary(workspace, name) if name in names else ActionSummary(name, "not made")
        for name in sorted({*names, *BUILT_IN})
    ]


def _summary(workspace: Workspace, name: str) -> ActionSummary:
    try:
        job = workspace.job(name, [])
        statuses = list(runner.stage_statuses(job))
    except ImocapError as error:
        return ActionSummary(name, "invalid", fault=str(error))
    cached = sum(status.stored is not None for status in statuses)
    if cached == len(statuses):
        state: State = "cached"
    elif any(job.store.current(job.action.name, s).is_file() for s in job.pipeline.stages):
        state = "partly cached"
    else:
        state = "not run"
    return ActionSummary(
        name,
        state,
        videos=len(job.action.videos),
        stages=len(statuses),
        cached=cached,
        headline=headline_of(job.store.report(job.action.name) / "summary.csv"),
    )


def headline_of(summary: Path) -> str:
    """The main figures of a report's last result; empty when there is no table of them."""
    if not summary.is_file():
        return ""
    with summary.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    if not rows:
        return ""
    values = [(text, _number(rows[-1].get(column))) for column, text in HEADLINE]
    parts = [text.format(value) for text, value in values if value is not None]
    return ", ".join(parts[:HEADLINE_PARTS])


def _number(text: str | None) -> float | None:
    try:
        value = float(text or "")
    except ValueError:
        return None
    return value if math.isfinite(value) else None
