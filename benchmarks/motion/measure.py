"""`imocap benchmark protocol`, `trials`, `yoga` and `h36m`: how good the motion is."""

from __future__ import annotations

from pathlib import Path

from benchmarks.actions.choice import DATA, TITLES, Choice
from benchmarks.actions.prepare import action_names, chosen_names, ready_job, standing_job
from benchmarks.motion.tables import Benchmark, csv_text, json_text, markdown
from benchmarks.parallel import Named, each
from benchmarks.scoring.score import score_action, standing_score
from benchmarks.scoring.score_file import ActionScore
from imocap_core.errors import WorkFailed
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace


def measure(
    workspace: Workspace, choice: Choice, display: Display, jobs: int = 1
) -> tuple[Benchmark, Path]:
    """Run what is not finished, write the tables after every action; them and their folder.

    The tables hold every action whose kept numbers are still valid, also those not chosen now.
    WorkFailed, after all others have run, when an action could not be done.
    """
    folder = choice.folder(workspace.root)
    every, wanted = action_names(workspace.root, choice), chosen_names(workspace.root, choice)
    scores = _standing(workspace, choice, [name for name in every if name not in wanted])
    tasks = [(name, (workspace.root, choice, name)) for name in wanted]
    faults = []
    for ended in each(one_action, tasks, jobs, display):
        if ended.made is None:
            faults.append(f"{ended.name}: {ended.fault}")
            continue
        scores[ended.name] = ended.made
        write(_benchmark(choice, every, scores), folder)
    if faults:
        raise WorkFailed("\n".join(faults))
    return _benchmark(choice, every, scores), folder


def one_action(display: Display, root: Path, choice: Choice, name: str) -> ActionScore:
    """Bring one action up to date and score it."""
    named = Named(display, name)
    job = ready_job(Workspace(root), choice, name, (), named)
    folder = choice.folder(root)
    return score_action(job, named, kept_file(folder, name), folder / "costs")


def kept_file(folder: Path, name: str, variant: str = "") -> Path:
    """Where the numbers of an action are kept."""
    return folder / "scores" / variant / f"{name}.json"


def write(benchmark: Benchmark, folder: Path) -> None:
    """The three tables."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in (
        ("table.md", markdown(benchmark)),
        ("numbers.csv", csv_text(benchmark)),
        ("numbers.json", json_text(benchmark)),
    ):
        (folder / name).write_text(text, encoding="utf-8")


def _standing(workspace: Workspace, choice: Choice, names: list[str]) -> dict[str, ActionScore]:
    folder = choice.folder(workspace.root)
    found = {}
    for name in names:
        kept = kept_file(folder, name)
        if kept.is_file():
            score = standing_score(standing_job(workspace, choice, name, ()), kept)
            if score is not None:
                found[name] = score
    return found


def _benchmark(choice: Choice, every: list[str], scores: dict[str, ActionScore]) -> Benchmark:
    return Benchmark(
        TITLES[choice.name],
        choice.command,
        DATA[choice.name],
        "" if choice.name == "yoga" else choice.detector,
        [scores[name] for name in every if name in scores],
        [name for name in every if name not in scores],
    )
