"""Which picture and which table stands where in a report, and what is said about it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from imocap_core.artifacts.schemas import Table
from imocap_core.report.files import Picture

OPEN = "open"  # the table of sentences on what the videos leave open
PROGRAMS = "metrics"  # the long table, for programs only


@dataclass(frozen=True)
class Plan:
    """A section before it is filled: names of tables, beginnings of the names of picture files."""

    title: str
    said: str
    pictures: tuple[str, ...] = ()
    tables: tuple[str, ...] = ()
    folded: tuple[str, ...] = ()  # tables and pictures that wait for a click


@dataclass(frozen=True)
class Section:
    """A part of the page."""

    title: str
    said: str
    sentences: list[str] = field(default_factory=list)
    pictures: list[Picture] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    folded_pictures: list[Picture] = field(default_factory=list)
    folded_tables: list[Table] = field(default_factory=list)

    @property
    def empty(self) -> bool:
        """Whether it would be a title and nothing below."""
        parts = (self.sentences, self.pictures, self.tables)
        return not any((*parts, self.folded_pictures, self.folded_tables))


PLANS = (
    Plan(
        "In short",
        "Mean over the videos. Monocular: each video by itself; single pass: all videos together, "
        "once; after loop: the result.",
        ("moments.",),
        ("summary",),
    ),
    Plan(
        "What the videos leave open",
        "Read from the result's own covariances; no truth is needed.",
        (),
        (OPEN,),
    ),
    Plan(
        "Synchronisation",
        "Frames are matched through poses. Going from a video to a second, to a third and back "
        "must end at the start: that is what cycle consistency asks for, and affinities alone "
        "do not give it.",
        ("cycle.", "warp.", "affinity."),
        ("sync",),
        ("trust", "cycles"),
    ),
    Plan(
        "Motion",
        "What one video says alone is right in its picture and wrong in depth; the videos "
        "together correct it.",
        ("results.", "joint_errors."),
        ("pose",),
        ("joint_sets", "overlay_"),
    ),
    Plan("Hands", "", ("hands",), ("hands",)),
    Plan(
        "How sure",
        "Claimed standard deviations, and true errors where the truth is known.",
        ("uncertainty.",),
        (),
        ("uncertainty", "uncertainty_joints", "viewpoints"),
    ),
    Plan("Cameras and paths", "", ("scene.",), ("cameras", "videos")),
    Plan(
        "The loop",
        "Synchronisation and motion in turn, until the correspondences settle.",
        ("rounds.",),
        ("rounds",),
    ),
    Plan("Time", "", (), ("timings",)),
    Plan("Not scored", "", (), ("unscored",)),
)
REST = "Further"


def sections(tables: Sequence[Table], pictures: Sequence[Picture]) -> list[Section]:
    """The page's parts, in order; what no plan names comes last. Empty parts are left out."""
    known = {t.name: t for t in tables if t.name != PROGRAMS}
    left = list(pictures)
    made = []
    for plan in PLANS:
        shown = _taken(left, plan.pictures)
        folded = _taken(left, plan.folded)
        named = [known.pop(name) for name in plan.tables if name in known]
        sentences = [str(row[0]) for t in named if t.name == OPEN for row in t.rows]
        made.append(
            Section(
                plan.title,
                plan.said,
                sentences,
                shown,
                [t for t in named if t.name != OPEN],
                folded,
                [known.pop(name) for name in plan.folded if name in known],
            )
        )
    made.append(Section(REST, "", pictures=left, tables=list(known.values())))
    return [section for section in made if not section.empty]


def _taken(left: list[Picture], beginnings: Sequence[str]) -> list[Picture]:
    """The pictures whose files begin so, in that order; they are gone from `left`."""
    taken = [p for beginning in beginnings for p in left if p.file.startswith(beginning)]
    left[:] = [p for p in left if p not in taken]
    return taken
