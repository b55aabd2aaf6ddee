"""`imocap benchmark wrong_start`: is a wrongly started view recovered by the others?"""

from __future__ import annotations

from rich.table import Table

from benchmarks.actions.choice import Choice
from benchmarks.names import BenchmarkOptions, table_of_rows
from benchmarks.parallel import each
from benchmarks.tables import write_rows, write_texts
from benchmarks.wrong_start.measure import ActionRows, measured_action, names_of
from benchmarks.wrong_start.tables import markdown
from imocap_core.errors import WorkFailed
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace

NAME = "wrong_start"


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """Results of all actions with how many were recovered, and each video's motions.

    Everything is written after every action; WorkFailed when no action could be measured.
    """
    choice = Choice("trials", options.detector, videos=options.videos, only=options.only)
    names = names_of(workspace.root, choice)
    folder = choice.folder(workspace.root) / NAME
    done: dict[str, ActionRows] = {}
    faults, text = [], ""
    tasks = [(name, (workspace, choice, name)) for name in names]
    for end in each(measured_action, tasks, options.jobs, display):
        if end.result is None:
            faults.append(f"{end.name}: {end.fault}")
            continue
        done[end.name] = end.result
        ordered = [done[name] for name in names if name in done]
        rows = [row for action in ordered for row in action.results]
        motions = [row for action in ordered for row in action.hypotheses]
        text = markdown(rows, motions, [name for name in names if name not in done])
        write_rows(folder, "results", rows)
        write_rows(folder, "motions", motions)
        write_texts(folder, {"table.md": text})
    if not done:
        raise WorkFailed("\n".join(faults))
    return [text, table_of_rows(motions), *faults, f"Written to {folder}"]
