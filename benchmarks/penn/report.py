"""`imocap benchmark penn`: groups of four real clips of one action, and hidden limbs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.table import Table

from benchmarks.left_out import SetErrors, run_to_prediction, set_errors
from benchmarks.names import BenchmarkOptions
from benchmarks.parallel import ActionDisplay, each
from benchmarks.penn.clips import Clip, groups_of, make_group, penn_clips
from benchmarks.penn.hidden_limbs import HiddenLimbs, hidden_limbs
from benchmarks.tables import cell, markdown_table, write_texts
from imocap_core.errors import WrongUse
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace

PARTS = ("groups", "lifter")
HEAD = ("action", "groups", "left out, % of height", "within 10 %", "monocular, %")
HEAD_LIFTER = ("clips", "lifter within 0.2 torso, %", "straight, %")


@dataclass(frozen=True)
class PennRow:
    """One action: the errors of its groups, and of limbs hidden from the lifter in their clips."""

    action: str
    groups: list[SetErrors]
    clips: int
    limbs: HiddenLimbs | None


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """The table as Markdown (`--only` actions, `--videos` groups of each), and its folder."""
    clips = penn_clips(workspace.root)
    actions = sorted({clip.action for clip in clips})
    _check(options, actions)
    parts = options.variants or PARTS
    chosen = {a: groups_of(clips, a, options.videos) for a in options.only or actions}
    tasks = [
        (f"{action}_{k:02d}", (workspace.root, f"{action}_{k:02d}", group))
        for action, groups in chosen.items()
        for k, group in enumerate(groups)
        if "groups" in parts
    ]
    ends = list(each(group_errors, tasks, options.jobs, display))
    errors = {end.name: end.result for end in ends if end.result is not None}
    faults = [f"{end.name}: {end.fault}" for end in ends if end.result is None]
    rows = []
    for action, groups in chosen.items():
        shown = [clip for group in groups for clip in group]
        of_action = [e for name, e in errors.items() if name.rpartition("_")[0] == action]
        limbs = hidden_limbs(shown) if "lifter" in parts else None
        rows.append(PennRow(action, of_action, len(shown), limbs))
    text = markdown(rows)
    folder = workspace.root / "artifacts" / "benchmark" / "penn"
    write_texts(folder, {"table.md": text})
    return [text, *faults, f"Written to {folder}"]


def group_errors(display: Display, root: Path, name: str, group: Sequence[Clip]) -> SetErrors:
    """The errors of one group, made and run at the defaults."""
    folder = root / "artifacts" / "benchmark" / "penn"
    action, shown = folder / "actions" / name, ActionDisplay(display, name)
    make_group(action, group)
    job = Workspace(folder).ready_job(str(action), [], shown)
    return set_errors(run_to_prediction(job, shown))


def markdown(rows: Sequence[PennRow]) -> str:
    """A row an action, and the median over all groups."""
    cells = [_cells(row.action, row.groups, row.clips, row.limbs) for row in rows]
    every = [error for row in rows for error in row.groups]
    limbs = [row.limbs for row in rows if row.limbs is not None]
    mean = None
    if limbs:
        shares = [(x.lifter_pct, x.straight_pct) for x in limbs]
        mean = HiddenLimbs(*(float(x) for x in np.mean(shares, axis=0)))
    cells.append(_cells("all", every, sum(row.clips for row in rows), mean))
    return markdown_table((*HEAD, *HEAD_LIFTER), cells) + "\n"


def _cells(
    name: str, groups: Sequence[SetErrors], clips: int, limbs: HiddenLimbs | None
) -> list[str]:
    columns = [[g.error_pct, g.share_10, g.monocular_pct] for g in groups]
    medians = (
        [cell(float(x), 2) for x in np.nanmedian(columns, axis=0)]
        if groups
        else [cell(None, 2)] * 3
    )
    shares = (None, None) if limbs is None else (limbs.lifter_pct, limbs.straight_pct)
    return [name, str(len(groups)), *medians, str(clips), *(cell(x, 1) for x in shares)]


def _check(options: BenchmarkOptions, actions: Sequence[str]) -> None:
    """WrongUse, naming what there is, for an unknown action or part."""
    for option, given, there in (
        ("--only", options.only, actions),
        ("--variants", options.variants, PARTS),
    ):
        for name in given:
            if name not in there:
                raise WrongUse(f"{option} {name}: expected one of {', '.join(there)}")
