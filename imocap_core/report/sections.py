"""Order of the report: its sections, with their pictures, tables and introductions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from imocap_core.artifacts.schemas import Table
from imocap_core.report.files import Picture

SENTENCES = "open"  # the table of the observability report's sentences
PROGRAMS = "metrics"  # the long table, for programs only


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


PLANS = (
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
        (SENTENCES,),
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
    Plan("Cameras and paths", "", ("scene.",), ("cameras", "videos")),
    Plan(
        "The loop",
        "Synchronisation and motion are solved in turn until the correspondences converge.",
        ("rounds.",),
        ("rounds",),
    ),
    Plan("Time", "", (), ("timings",)),
    Plan("Not scored", "", (), ("unscored",)),
)
REST = "Other"
HEADLINE = (
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


def sections(tables: Sequence[Table], pictures: Sequence[Picture]) -> list[Section]:
    """The sections in order; content that no plan names comes last. Empty sections are omitted."""
    by_name = {t.name: _headline(t) for t in tables if t.name != PROGRAMS}
    left = list(pictures)
    filled = []
    for plan in PLANS:
        shown = _taken(left, plan.pictures)
        folded = _taken(left, plan.folded)
        named = [by_name.pop(name) for name in plan.tables if name in by_name]
        sentences = [str(row[0]) for t in named if t.name == SENTENCES for row in t.rows]
        filled.append(
            Section(
                plan.title,
                plan.lead,
                sentences,
                shown,
                [t for t in named if t.name != SENTENCES],
                folded,
                [by_name.pop(name) for name in plan.folded if name in by_name],
            )
        )
    filled.append(Section(REST, "", pictures=left, tables=list(by_name.values())))
    return [section for section in filled if not section.empty]


def _headline(table: Table) -> Table:
    """The columns of a table that the page shows."""
    if table.name != "summary":
        return table
    shown = [table.columns.index(name) for name in HEADLINE if name in table.columns]
    return table.model_copy(
        update={
            "columns": [table.columns[i] for i in shown],
            "rows": [[row[i] for i in shown] for row in table.rows],
        }
    )


def _taken(left: list[Picture], beginnings: Sequence[str]) -> list[Picture]:
    """The pictures whose file names start so, in that order; removed from `left`."""
    taken = [p for beginning in beginnings for p in left if p.file.startswith(beginning)]
    left[:] = [p for p in left if p not in taken]
    return taken
