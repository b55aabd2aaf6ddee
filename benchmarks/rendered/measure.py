"""Scores of rendered actions, brought up to date, and their table."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from benchmarks.parallel import ActionDisplay, each
from benchmarks.rendered.detections import detected_clips, detector_3d_errors
from benchmarks.rendered.jobs import (
    RenderedChoice,
    existing_rendered,
    ready_rendered,
    rendered_names,
)
from benchmarks.rendered.tables import markdown
from benchmarks.scoring.score import cached_score, score_action
from benchmarks.scoring.score_file import ActionScore
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace


def measure(
    workspace: Workspace, choice: RenderedChoice, display: Display, jobs: int = 1
) -> tuple[str, Path]:
    """Run what is not finished and write the tables after every action; them and their folder.

    An interrupted run goes on where it stopped: videos, detections, stages and numbers are stored.
    WorkFailed, after all others have run, when an action failed.
    """
    folder, root = choice.folder(workspace.root), workspace.root
    every = rendered_names(root)
    unknown = [name for name in choice.only if name not in every]
    if unknown:
        raise WrongUse(f"--only {unknown[0]}: expected one of {', '.join(every)}")
    chosen = [name for name in every if not choice.only or name in choice.only]
    done = {n: s for n in every if n not in chosen and (s := _cached(root, choice, n))}
    faults = []
    text = ""
    for ended in each(one_action, [(n, (root, choice, n)) for n in chosen], jobs, display):
        if ended.result is None:
            faults.append(f"{ended.name}: {ended.fault}")
            continue
        done[ended.name] = ended.result
        text = _written(root, choice, every, done)
    if faults:
        raise WorkFailed("\n".join(faults))
    return text, folder


def one_action(display: Display, root: Path, choice: RenderedChoice, name: str) -> ActionScore:
    """Bring one action up to date and score it."""
    action_display = ActionDisplay(display, name)
    job = ready_rendered(root, choice, name, action_display)
    costs = choice.folder(root) / "costs"
    return score_action(job, action_display, _score_path(root, choice, name), costs)


def _written(
    root: Path, choice: RenderedChoice, every: list[str], done: dict[str, ActionScore]
) -> str:
    """Write the report of the actions that are done; its text."""
    scores, films = [], []
    names: tuple[str, ...] = ()
    for name in (n for n in every if n in done):
        job = existing_rendered(root, choice, name)
        assert job is not None, "its score is of the action as it is"
        of_action, names = detected_clips(job)
        films += of_action
        numbers = {"estimator": detector_3d_errors(job), **done[name].numbers}
        scores.append(replace(done[name], numbers=numbers))
    missing = [name for name in every if name not in done]
    text = markdown(scores, films, names, missing, choice.command)
    (choice.folder(root) / "table.md").write_text(text, encoding="utf-8")
    return text


def _cached(root: Path, choice: RenderedChoice, name: str) -> ActionScore | None:
    """Stored numbers of an action that is not run now; None when anything of it has changed."""
    file, job = _score_path(root, choice, name), existing_rendered(root, choice, name)
    return cached_score(job, file) if job is not None and file.is_file() else None


def _score_path(root: Path, choice: RenderedChoice, name: str) -> Path:
    return choice.folder(root) / "scores" / f"{name}.json"
