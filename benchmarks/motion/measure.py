"""Scores of a set of actions, brought up to date, and their tables."""

from __future__ import annotations

from pathlib import Path

from benchmarks.actions.choice import AS_GIVEN, DATA, TITLES, Choice
from benchmarks.actions.prepare import action_names, chosen_names, existing_job, ready_job
from benchmarks.motion.tables import MotionBenchmark, csv_text, json_text, markdown
from benchmarks.parallel import ActionDisplay, each
from benchmarks.scoring.score import cached_score, score_action
from benchmarks.scoring.score_file import ActionScore
from benchmarks.tables import write_texts
from imocap_core.errors import WorkFailed
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace


def measure(
    workspace: Workspace, choice: Choice, display: Display, jobs: int = 1
) -> tuple[MotionBenchmark, Path]:
    """Run what is not finished, write the tables after every action; them and their folder.

    The tables show every action whose stored numbers are still valid, also those not chosen now.
    WorkFailed, after all others have run, when an action failed.
    """
    folder = choice.folder(workspace.root)
    names, chosen = action_names(workspace.root, choice), chosen_names(workspace.root, choice)
    scores = _cached(workspace, choice, [name for name in names if name not in chosen])
    tasks = [(name, (workspace.root, choice, name)) for name in chosen]
    faults = []
    for ended in each(one_action, tasks, jobs, display):
        if ended.result is None:
            faults.append(f"{ended.name}: {ended.fault}")
            continue
        scores[ended.name] = ended.result
        write(_benchmark(choice, names, scores), folder)
    if faults:
        raise WorkFailed("\n".join(faults))
    return _benchmark(choice, names, scores), folder


def one_action(display: Display, root: Path, choice: Choice, name: str) -> ActionScore:
    """Bring one action up to date and score it."""
    action_display = ActionDisplay(display, name)
    job = ready_job(Workspace(root), choice, name, (), action_display)
    folder = choice.folder(root)
    return score_action(job, action_display, score_path(folder, name), folder / "costs")


def score_path(folder: Path, name: str, variant: str = "") -> Path:
    """The file of an action's numbers."""
    return folder / "scores" / variant / f"{name}.json"


def write(benchmark: MotionBenchmark, folder: Path) -> None:
    """The three tables."""
    write_texts(
        folder,
        {
            "table.md": markdown(benchmark),
            "numbers.csv": csv_text(benchmark),
            "numbers.json": json_text(benchmark),
        },
    )


def _cached(workspace: Workspace, choice: Choice, names: list[str]) -> dict[str, ActionScore]:
    folder = choice.folder(workspace.root)
    scores = {}
    for name in names:
        file = score_path(folder, name)
        if file.is_file():
            score = cached_score(existing_job(workspace, choice, name, ()), file)
            if score is not None:
                scores[name] = score
    return scores


def _benchmark(choice: Choice, names: list[str], scores: dict[str, ActionScore]) -> MotionBenchmark:
    return MotionBenchmark(
        TITLES[choice.name],
        choice.command,
        DATA[choice.name],
        "" if choice.name in AS_GIVEN else choice.detector,
        [scores[name] for name in names if name in scores],
        [name for name in names if name not in scores],
    )
