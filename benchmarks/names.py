"""benchmark: measurements by name, as tables on the terminal and in the documentation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rich.table import Table

from benchmarks.actions.captured import data_folder
from imocap_core.errors import WrongUse
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace


@dataclass(frozen=True)
class Wanted:
    """The options of one `imocap benchmark`."""

    name: str
    detector: str
    sampling: str
    videos: int
    only: tuple[str, ...]
    on: str
    variants: tuple[str, ...]
    data: Path | None
    jobs: int
    docs: bool


def motion_tables(wanted: Wanted, workspace: Workspace, display: Display) -> tuple[str, list[str]]:
    """Measure; the table as Markdown, and where it was written."""
    from benchmarks.actions.choice import Choice
    from benchmarks.docs import check_marks, put_into_docs

    if wanted.name == "ablations":
        if (wanted.detector, wanted.videos) != ("fine_tuned", 4):
            raise WrongUse("ablations set --detector and --videos themselves; leave both out")
        base = Choice(wanted.on, sampling=wanted.sampling, only=wanted.only, data=wanted.data)
    else:
        if wanted.variants:
            raise WrongUse("--variants: only for `imocap benchmark ablations`")
        base = Choice(
            wanted.name, wanted.detector, wanted.sampling, wanted.videos, wanted.only,
            data=wanted.data,
        )  # fmt: skip
    label = f"ablations-{base.set_label}" if wanted.name == "ablations" else base.label
    if wanted.docs:
        check_marks(workspace.root, label)
    text, summary, folder = _measured(wanted, base, workspace, display)
    said = [f"Kept in {folder}"]
    if wanted.docs:
        said += [f"Put into {file}" for file in put_into_docs(workspace.root, label, text, summary)]
    return text, said


def _measured(
    wanted: Wanted, base: Any, workspace: Workspace, display: Display
) -> tuple[str, str, Path]:
    from benchmarks.ablations import measure as ablations
    from benchmarks.ablations import tables as ablation_tables
    from benchmarks.motion import measure as motion
    from benchmarks.motion import tables

    if wanted.name == "ablations":
        measured, folder = ablations.measure(workspace, base, wanted.variants, display, wanted.jobs)
        text, summary = ablation_tables.markdown(measured), ablation_tables.summary(measured)
    else:
        found, folder = motion.measure(workspace, base, display, wanted.jobs)
        text, summary = tables.markdown(found), tables.summary(found)
    return text, summary, folder


def solver_table(wanted: Wanted, workspace: Workspace, display: Display) -> tuple[str, list[str]]:
    """The solver's speed, its rivals' and how it grows, as Markdown; where it was written."""
    from benchmarks.docs import check_marks, put_into_docs
    from benchmarks.solver.measure import measure

    if wanted.docs:
        check_marks(workspace.root, "solver")
    folder = workspace.root / "artifacts" / "benchmark" / "solver"
    text = measure(workspace, wanted.only, display, folder)
    said = [f"Kept in {folder}"]
    if wanted.docs:
        said += [f"Put into {f}" for f in put_into_docs(workspace.root, "solver", text, text)]
    return text, said


def body_table(name: str, workspace: Workspace) -> Table:
    """The body's speed (`body`) or how well its bones fit measured skeletons (`bones`)."""
    rows: Sequence[Any]
    if name == "body":
        from benchmarks.body.speed import measure as speed

        rows = speed()
    else:
        from benchmarks.body.bones import measure as fit

        rows = fit(data_folder(workspace.root, "trials"))
    return _table(rows)


def lifter_table(wanted: Wanted, workspace: Workspace, display: Display) -> tuple[str, list[str]]:
    """The lifter alone on trials and protocol, as Markdown; where it was written."""
    from benchmarks.lifter.measure import markdown, measure, write_table

    rows = measure(workspace, wanted.only, display)
    file = write_table(rows, workspace.root / "artifacts" / "benchmark" / "lifter")
    return markdown(rows), [f"Kept in {file}"]


def trust_table(workspace: Workspace, display: Display) -> list[Table | str]:
    """Whether videos of another action and mirrored ones are found (`trust`), and how often."""
    from benchmarks.trust.poses import fitted, true_poses
    from benchmarks.trust.screened import among_decidable, measure, totals

    max_rate = workspace.pipeline().params.sync.max_rate
    rows = measure(fitted(workspace, display), max_rate)
    true = measure(true_poses(workspace), max_rate)
    said = [*totals(rows, "monocular fits"), *totals(true, "true poses")]
    return [_table(rows), _table(true), *said, *among_decidable(rows, true)]


def sync_tables(workspace: Workspace, sampling: str, only: tuple[str, ...], methods: str) -> str:
    """Synchronisation alone: accuracy by method and warp, events, speed (`sync`)."""
    from benchmarks.row_tables import markdown, write_tables
    from benchmarks.sync.accuracy import METHODS, accuracy, calibrated, events
    from benchmarks.sync.speed import speed

    chosen = tuple(word.strip() for word in methods.split(",") if word.strip()) or METHODS
    if unknown := set(chosen) - set(METHODS):
        raise WrongUse(f"--variants: expected some of {', '.join(METHODS)}, got {unknown.pop()}")
    settings = workspace.pipeline().params.sync
    protocol, trials = (data_folder(workspace.root, kind) for kind in ("protocol", "trials"))
    tables: dict[str, Sequence[Any]] = {
        f"accuracy-{sampling}": accuracy(protocol, sampling, settings, chosen, only),
        f"calibration-{sampling}": calibrated(protocol, sampling, settings, only),
        "events": events(trials, settings, only),
        "speed": speed(settings) if not only else [],
    }
    folder = workspace.root / "artifacts" / "benchmark" / "sync"
    told = []
    for name, rows in tables.items():
        if rows:
            write_tables(folder, name, rows)
            told += [f"## {name}", markdown(rows)]
    return "\n\n".join([*told, f"Kept in {folder}"])


def _table(rows: Sequence[Any]) -> Table:
    """A column a field."""
    told = [asdict(row) for row in rows]
    table = Table(*told[0], box=None, pad_edge=False)
    for row in told:
        table.add_row(*(f"{v:.2f}" if isinstance(v, float) else str(v) for v in row.values()))
    return table
