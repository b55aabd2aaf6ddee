"""Scores of rendered actions, brought up to date, and their table."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from benchmarks.actions.action_folder import is_made
from benchmarks.actions.captured import DEFAULT_VIDEOS, data_folder
from benchmarks.parallel import ActionDisplay, each
from benchmarks.rendered.action import key_of, make_rendered
from benchmarks.rendered.detections import detected_clips, detector_3d_errors
from benchmarks.rendered.tables import markdown
from benchmarks.scoring.score import cached_score, score_action
from benchmarks.scoring.score_file import ActionScore
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.pipeline.runner import Display, Job
from imocap_core.workspace import Workspace


@dataclass(frozen=True)
class RenderedChoice:
    """What to run: videos per action, whether pictures have a quarter of the pixels, the actions
    (all when empty)."""

    videos: int = DEFAULT_VIDEOS
    small: bool = False
    only: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not 1 <= self.videos <= DEFAULT_VIDEOS:
            raise WrongUse(f"--videos: expected 1 to {DEFAULT_VIDEOS}, got {self.videos}")

    @property
    def label(self) -> str:
        """The name of its folder and table."""
        return f"rendered-{self.videos}v" + "-small" * self.small

    @property
    def command(self) -> str:
        """The command that measures all actions of this choice."""
        return f"imocap benchmark rendered --videos {self.videos}" + " --small" * self.small

    def folder(self, root: Path) -> Path:
        """The folder of its actions, artifacts, scores and tables."""
        return root / "artifacts" / "benchmark" / self.label


def measure(
    workspace: Workspace, choice: RenderedChoice, display: Display, jobs: int = 1
) -> tuple[str, Path]:
    """Run what is not finished and write the tables after every action; them and their folder.

    An interrupted run goes on where it stopped: videos, detections, stages and numbers are stored.
    WorkFailed, after all others have run, when an action failed.
    """
    folder, root = choice.folder(workspace.root), workspace.root
    every = [file.stem for file in sorted(data_folder(root, "trials").glob("*.npz"))]
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
    action_display, folder = ActionDisplay(display, name), choice.folder(root)
    if _stale(root, choice, name):
        action_display.started("render", ["its performances are not rendered"])
        file = data_folder(root, "trials") / f"{name}.npz"
        make_rendered(
            _action(root, choice, name),
            name,
            file,
            choice.videos,
            choice.small,
            action_display.progress,
        )
    job = Workspace(folder).ready_job(str(_action(root, choice, name)), [], action_display)
    return score_action(job, action_display, _score_path(root, choice, name), folder / "costs")


def _written(
    root: Path, choice: RenderedChoice, every: list[str], done: dict[str, ActionScore]
) -> str:
    """Write the report of the actions that are done; its text."""
    scores, films = [], []
    names: tuple[str, ...] = ()
    for name in (n for n in every if n in done):
        job = _job(root, choice, name)
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
    file = _score_path(root, choice, name)
    if not file.is_file() or _stale(root, choice, name):
        return None
    return cached_score(_job(root, choice, name), file)


def _stale(root: Path, choice: RenderedChoice, name: str) -> bool:
    file = data_folder(root, "trials") / f"{name}.npz"
    key = key_of(name, file, choice.videos, choice.small)
    return not is_made(_action(root, choice, name), key)


def _job(root: Path, choice: RenderedChoice, name: str) -> Job:
    return Workspace(choice.folder(root)).job(str(_action(root, choice, name)), [])


def _action(root: Path, choice: RenderedChoice, name: str) -> Path:
    return choice.folder(root) / "actions" / name


def _score_path(root: Path, choice: RenderedChoice, name: str) -> Path:
    return choice.folder(root) / "scores" / f"{name}.json"
