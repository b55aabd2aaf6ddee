"""Order of the report: its sections, with their pictures, tables and introductions."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from imocap_core.artifacts.schemas import Table
from imocap_core.artifacts.schemas.motion_schemas import Cell
from imocap_core.evaluate.scoreboard import AFTER_LOOP, MONOCULAR, SINGLE_PASS
from imocap_core.metrics.scoring import ALL_VIDEOS
from imocap_core.report.table_files import Picture, column_title

_PLAN = tomllib.loads(Path(__file__).with_name("sections.toml").read_text(encoding="utf-8"))
_SENTENCES = "open"  # the table of the observability report's sentences
_PROGRAMS = "metrics"  # the long table, for programs only
_SCORED = "mpjpe_mm"  # a column that is there when the truth is


@dataclass(frozen=True)
class Section:
    """A section of the page, with its content."""

    title: str
    lead: str
    sentences: list[str] = field(default_factory=list)
    pictures: list[Picture] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    folded_pictures: list[Picture] = field(default_factory=list)
    folded_tables: list[Table] = field(default_factory=list)

    @property
    def empty(self) -> bool:
        """Whether there is only a title."""
        parts = (self.sentences, self.pictures, self.tables)
        return not any((*parts, self.folded_pictures, self.folded_tables))


def sections(
    tables: Sequence[Table], pictures: Sequence[Picture], videos: int = 3
) -> list[Section]:
    """The sections in order; content that no plan names comes last. Empty sections are omitted.

    videos: of the action; with one or two of them some introductions differ, and with one there is
    nothing to compare.
    """
    by_name = {t.name: _shown(t, videos) for t in tables if t.name != _PROGRAMS}
    left = list(pictures)
    filled = []
    for plan in _plans_for(by_name, videos):
        opened = _taken(left, plan.get("pictures", ()))
        folded = _taken(left, plan.get("folded", ()))
        named = [by_name.pop(name) for name in plan.get("tables", ()) if name in by_name]
        filled.append(
            Section(
                plan["title"],
                plan["lead"],
                [str(row[0]) for t in named if t.name == _SENTENCES for row in t.rows],
                opened,
                [t for t in named if t.name != _SENTENCES],
                folded,
                [by_name.pop(name) for name in plan.get("folded", ()) if name in by_name],
            )
        )
    filled.append(Section("Other", "", pictures=left, tables=list(by_name.values())))
    return [section for section in filled if not section.empty]


def _plans_for(tables: Mapping[str, Table], videos: int) -> list[dict[str, Any]]:
    """The plans, with the introductions of so few videos; without truth there is no summary, whose
    table then only has what `Motion` shows."""
    few = {1: "lead_of_one", 2: "lead_of_two"}.get(videos, "lead")
    plans = [plan | {"lead": plan.get(few, plan["lead"])} for plan in _PLAN["section"]]
    if _SCORED not in getattr(tables.get("summary"), "columns", [_SCORED]):
        title = "The video" if videos == 1 else "The same moments"
        plans[0] |= {"title": title, "lead": "", "tables": ()}
        motion = next(plan for plan in plans if plan["title"] == "Motion")
        motion["folded"] = ("summary", *motion["folded"])
    return plans


def _shown(table: Table, videos: int) -> Table:
    """A table as the page shows it: the headline columns of the summary, one row a reason of what
    is not scored, no empty columns, and of a single video nothing that compares it with itself."""
    columns, rows = table.columns, table.rows
    if table.name == "unscored":
        metrics: dict[str, list[str]] = {}
        for metric, reason in rows:
            metrics.setdefault(str(reason), []).append(column_title(str(metric)))
        columns = ["reason", "metrics"]
        rows = [[reason, "; ".join(names)] for reason, names in metrics.items()]
    order = list(range(len(columns)))
    if table.name == "summary":
        order = [columns.index(name) for name in _PLAN["headline"] if name in columns]
    shown = [k for k in order if any(row[k] is not None for row in rows)]
    if videos == 1:
        shown = [k for k in shown if columns[k] != "matched_share"]
    rows = [[row[k] for k in shown] for row in rows]
    rows = _of_single_video(rows) if videos == 1 else rows
    return table.model_copy(update={"columns": [columns[k] for k in shown], "rows": rows})


def _of_single_video(rows: Sequence[Sequence[Cell]]) -> list[list[Cell]]:
    """Without rows of the stages before the last, means over all videos, and the reference role."""
    repeated = {MONOCULAR, SINGLE_PASS}
    if any(ALL_VIDEOS not in row for row in rows):
        repeated.add(ALL_VIDEOS)

    def single(cell: Cell) -> Cell:
        if not isinstance(cell, str):
            return cell
        return "result" if cell == AFTER_LOOP else cell.removesuffix(" (reference)")

    return [list(map(single, row)) for row in rows if repeated.isdisjoint(map(str, row))]


def _taken(left: list[Picture], beginnings: Sequence[str]) -> list[Picture]:
    """The pictures whose file names start so, in that order; removed from `left`."""
    taken = [p for beginning in beginnings for p in left if p.file.startswith(beginning)]
    left[:] = [p for p in left if p not in taken]
    return taken
