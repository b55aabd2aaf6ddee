"""Order of the report: its sections, with their pictures, tables and introductions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from imocap_core.artifacts.schemas import Table
from imocap_core.artifacts.schemas.motion_schemas import Cell
from imocap_core.evaluate.scoreboard import AFTER_LOOP, MONOCULAR, SINGLE_PASS
from imocap_core.metrics.scoring import ALL_VIDEOS
from imocap_core.report.table_files import Picture, column_title

_HEADLINE = (
    "result",
    "mpjpe_mm",
    "mpjpe_24_mm",
    "mpjpe_scaled_mm",
    "pa_mpjpe_mm",
    "acceleration_error_m_s2",
    "root_path_error_mm",
    "camera_rotation_error_deg",
    "sync_error_pct",
    "sync_error_frames",
    "matched_share",
    "cycle_residual_frames",
    "reprojection_px",
)
"""Columns of the summary that the page shows; its CSV file has all."""


def headline(table: Table) -> Table:
    """The columns of the summary that the page shows; other tables as they are."""
    if table.name != "summary":
        return table
    shown = [table.columns.index(name) for name in _HEADLINE if name in table.columns]
    return _with_columns(table, shown)


def without_empty_columns(table: Table) -> Table:
    """Without columns in which no row has a value."""
    shown = [k for k in range(len(table.columns)) if any(row[k] is not None for row in table.rows)]
    return _with_columns(table, shown)


def _with_columns(table: Table, shown: list[int]) -> Table:
    return table.model_copy(
        update={
            "columns": [table.columns[k] for k in shown],
            "rows": [[row[k] for k in shown] for row in table.rows],
        }
    )


def grouped_reasons(table: Table) -> Table:
    """Metrics that are not scored, one row a reason; other tables as they are."""
    if table.name != "unscored":
        return table
    metrics: dict[str, list[str]] = {}
    for metric, reason in table.rows:
        metrics.setdefault(str(reason), []).append(column_title(str(metric)))
    rows = [[reason, "; ".join(names)] for reason, names in metrics.items()]
    return table.model_copy(update={"columns": ["reason", "metrics"], "rows": rows})


def of_single_video(table: Table) -> Table:
    """Without what compares the single video with itself: rows of the stages before the last and
    means over all videos, its role as the reference, its share of matches."""
    repeated = {MONOCULAR, SINGLE_PASS}
    if any(ALL_VIDEOS not in row for row in table.rows):
        repeated.add(ALL_VIDEOS)
    columns = [k for k, name in enumerate(table.columns) if name != "matched_share"]
    rows = [
        [_of_single(row[k]) for k in columns]
        for row in table.rows
        if not any(cell in repeated for cell in row if isinstance(cell, str))
    ]
    return table.model_copy(update={"columns": [table.columns[k] for k in columns], "rows": rows})


def _of_single(cell: Cell) -> Cell:
    if not isinstance(cell, str):
        return cell
    return "result" if cell == AFTER_LOOP else cell.removesuffix(" (reference)")


_SENTENCES = "open"  # the table of the observability report's sentences
_PROGRAMS = "metrics"  # the long table, for programs only
_SCORED = "mpjpe_mm"  # a column that is there when the truth is


@dataclass(frozen=True)
class Plan:
    """A section's content by name: names of tables, beginnings of the names of picture files."""

    title: str
    lead: str
    pictures: tuple[str, ...] = ()
    tables: tuple[str, ...] = ()
    folded: tuple[str, ...] = ()  # tables and pictures shown on a click


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


_PLANS = (
    Plan(
        "Summary",
        "Mean over the videos. Monocular: each video alone; single pass: all videos jointly, once; "
        "after loop: the final result.",
        ("moments.",),
        ("summary",),
    ),
    Plan(
        "Observability",
        "What the videos determine poorly, from the covariances of the result; needs no truth.",
        (),
        (_SENTENCES, "leave_one_out"),
    ),
    Plan(
        "Synchronisation",
        "Frames are matched by their poses. A round trip from a video to a second, to a third and "
        "back must end at its start (cycle consistency), which affinities alone do not ensure.",
        ("cycle.", "warp.", "affinity."),
        ("sync",),
        ("trust", "cycles"),
    ),
    Plan(
        "Motion",
        "The estimate from one video alone fits its picture but errs in depth; the videos together "
        "correct it.",
        ("body_", "results.", "joint_errors."),
        ("pose",),
        ("joint_sets", "whole_body", "joints", "joint_rotations", "overlay_"),
    ),
    Plan("Hands", "", ("hands",), ("hands",)),
    Plan(
        "Uncertainty",
        "Claimed standard deviations, and true errors where the truth is known.",
        ("uncertainty.",),
        (),
        ("uncertainty", "uncertainty_joints", "viewpoints"),
    ),
    Plan("Cameras and paths", "", ("scene.",), ("cameras", "ground", "videos")),
    Plan(
        "The loop",
        "Synchronisation and motion are solved in turn until the correspondences converge.",
        ("rounds.",),
        ("rounds", "second_look"),
    ),
    Plan("Time", "", (), ("timings",)),
    Plan("Not scored", "", (), ("unscored",)),
)
_LEADS_OF_ONE = {
    "Summary": "",
    "Motion": "The estimate from one video fits its picture; its depth rests on the pose prior.",
}
_LEADS_OF_TWO = {
    "Synchronisation": "Frames are matched by their poses. A third video would check the matches: "
    "a round trip over three must end at its start."
}
_NO_TRUTH, _NO_TRUTH_OF_ONE = "The same moments", "The video"  # first section, nothing scored
_REST = "Other"


def sections(
    tables: Sequence[Table], pictures: Sequence[Picture], videos: int = 3
) -> list[Section]:
    """The sections in order; content that no plan names comes last. Empty sections are omitted.

    videos: of the action; with one or two of them some introductions differ, and with one there is
    nothing to compare.
    """
    shown = [_shown(t, videos) for t in tables if t.name != _PROGRAMS]
    by_name = {t.name: t for t in shown}
    left = list(pictures)
    filled = []
    for plan in plans_for(by_name, videos):
        opened = _taken(left, plan.pictures)
        folded = _taken(left, plan.folded)
        named = [by_name.pop(name) for name in plan.tables if name in by_name]
        sentences = [str(row[0]) for t in named if t.name == _SENTENCES for row in t.rows]
        filled.append(
            Section(
                plan.title,
                plan.lead,
                sentences,
                opened,
                [t for t in named if t.name != _SENTENCES],
                folded,
                [by_name.pop(name) for name in plan.folded if name in by_name],
            )
        )
    filled.append(Section(_REST, "", pictures=left, tables=list(by_name.values())))
    return [section for section in filled if not section.empty]


def plans_for(tables: Mapping[str, Table], videos: int) -> list[Plan]:
    """The plans, with the introductions of so few videos; without truth there is no summary, whose
    table then only has what `Motion` shows."""
    leads = {1: _LEADS_OF_ONE, 2: _LEADS_OF_TWO}.get(videos, {})
    plans = [replace(plan, lead=leads.get(plan.title, plan.lead)) for plan in _PLANS]
    if _SCORED in getattr(tables.get("summary"), "columns", [_SCORED]):
        return plans
    title = _NO_TRUTH_OF_ONE if videos == 1 else _NO_TRUTH
    plans[0] = replace(plans[0], title=title, lead="", tables=())
    motion = next(k for k, plan in enumerate(plans) if plan.title == "Motion")
    plans[motion] = replace(plans[motion], folded=("summary", *plans[motion].folded))
    return plans


def _shown(table: Table, videos: int) -> Table:
    """A table as the page shows it."""
    table = without_empty_columns(grouped_reasons(headline(table)))
    return of_single_video(table) if videos == 1 else table


def _taken(left: list[Picture], beginnings: Sequence[str]) -> list[Picture]:
    """The pictures whose file names start so, in that order; removed from `left`."""
    taken = [p for beginning in beginnings for p in left if p.file.startswith(beginning)]
    left[:] = [p for p in left if p not in taken]
    return taken
