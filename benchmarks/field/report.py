"""`imocap benchmark field`: real clips of exercises and throws at the user's defaults."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

from rich.table import Table

from benchmarks.field.measure import FieldSet, chosen_sets, field_truth, measure_set
from benchmarks.names import BenchmarkOptions
from benchmarks.parallel import each
from benchmarks.tables import DETAILS, cell, markdown_table, write_texts
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace

HEAD = ("set", "right", "of", "left out, % of height", "within 10 %", "monocular, %", "wrong")


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """The tables as Markdown, and where they were written."""
    _, truth = field_truth(workspace.root)
    tasks = [(name, (workspace.root, name)) for name in chosen_sets(truth, options.only)]
    sets, faults = list[FieldSet](), list[str]()
    for end in each(measure_set, tasks, options.jobs, display):
        if end.result is None:
            faults.append(f"{end.name}: {end.fault}")
        else:
            sets.append(end.result)
    folder = workspace.root / "artifacts" / "benchmark" / "field"
    text = markdown(sets)
    write_texts(folder, {"table.md": text})
    return [text, *faults, f"Written to {folder}"]


def markdown(sets: Sequence[FieldSet]) -> str:
    """A row a set, and how often each measure is right."""
    rows = [
        [
            s.name,
            str(sum(f.right for f in s.facts)),
            str(len(s.facts)),
            cell(s.errors.error_pct, 2),
            cell(s.errors.share_10, 2),
            cell(s.errors.monocular_pct, 2),
            ", ".join(f"{f.name} {f.value:.4g}" for f in s.facts if not f.right),
        ]
        for s in sets
    ]
    facts = [f for s in sets for f in s.facts]
    rows.append(["all", str(sum(f.right for f in facts)), str(len(facts)), *[""] * 4])
    counts = defaultdict[str, list[bool]](list)
    for fact in facts:
        counts[fact.name].append(fact.right)
    measures = [[name, str(sum(x)), str(len(x))] for name, x in counts.items()]
    by_set, by_measure = (
        markdown_table(HEAD, rows),
        markdown_table(("measure", *HEAD[1:3]), measures),
    )
    return f"{by_set}\n\n{DETAILS}\n\n{by_measure}\n"
