"""`imocap benchmark rendered`: from pixels to motion with a real detector's errors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from benchmarks.actions.action_folder import is_made
from benchmarks.actions.captured import MAX_VIDEOS, data_folder
from benchmarks.parallel import Named, each
from benchmarks.rendered.action import key_of, make_rendered
from benchmarks.rendered.films import films_of, own_estimate
from benchmarks.rendered.tables import markdown
from benchmarks.scoring.score import score_action, standing_score
from benchmarks.scoring.score_file import ActionScore
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.pipeline.runner import Display, Job
from imocap_core.workspace import Workspace


@dataclass(frozen=True)
class Rendering:
    """What to run: videos an action, small pictures (a quarter of them), the actions (all when
    empty)."""

    videos: int = MAX_VIDEOS
    small: bool = False
    only: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not 1 <= self.videos <= MAX_VIDEOS:
            raise WrongUse(f"--videos: expected 1 to {MAX_VIDEOS}, got {self.videos}")

    @property
    def label(self) -> str:
        """A name for its folder and table."""
        return f"rendered-{self.videos}v" + "-small" * self.small

    @property
    def command(self) -> str:
        """The command that makes all of it."""
        return f"imocap benchmark rendered --videos {self.videos}" + " --small" * self.small

    def folder(self, root: Path) -> Path:
        """Where its actions, artifacts, scores and tables lie."""
        return root / "artifacts" / "benchmark" / self.label


def measure(
    workspace: Workspace, choice: Rendering, display: Display, jobs: int = 1
) -> tuple[str, Path]:
    """Run what is not finished and write the tables after every action; them and their folder.

    What was finished before a break is kept: films, detections of each video, stages, numbers.
    WorkFailed, after all others have run, when an action could not be done.
    """
    folder, root = choice.folder(workspace.root), workspace.root
    every = [file.stem for file in sorted(data_folder(root, "trials").glob("*.npz"))]
    unknown = [name for name in choice.only if name not in every]
    if unknown:
        raise WrongUse(f"--only {unknown[0]}: there are {', '.join(every)}")
    wanted = [name for name in every if not choice.only or name in choice.only]
    done = {n: s for n in every if n not in wanted and (s := _standing(root, choice, n))}
    faults = []
    text = ""
    for ended in each(one_action, [(n, (root, choice, n)) for n in wanted], jobs, display):
        if ended.made is None:
            faults.append(f"{ended.name}: {ended.fault}")
            continue
        done[ended.name] = ended.made
        text = _written(root, choice, every, done)
    if faults:
        raise WorkFailed("\n".join(faults))
    return text, folder


def one_action(display: Display, root: Path, choice: Rendering, name: str) -> ActionScore:
    """Bring one action up to date and score it."""
    named, folder = Named(display, name), choice.folder(root)
    if _stale(root, choice, name):
        named.started("film", ["its performances are not rendered"])
        file, place = data_folder(root, "trials") / f"{name}.npz", _action(root, choice, name)
        make_rendered(place, name, file, choice.videos, choice.small, named.progress)
    job = Workspace(folder).ready_job(str(_action(root, choice, name)), [], named)
    return score_action(job, named, _kept(root, choice, name), folder / "costs")


def _written(root: Path, choice: Rendering, every: list[str], done: dict[str, ActionScore]) -> str:
    """The report of what is done, written."""
    scores, films = [], []
    names: tuple[str, ...] = ()
    for name in (n for n in every if n in done):
        job = _job(root, choice, name)
        own, names = films_of(job)
        films += own
        numbers = {"estimator": own_estimate(job), **done[name].numbers}
        scores.append(replace(done[name], numbers=numbers))
    missing = [name for name in every if name not in done]
    text = markdown(scores, films, names, missing, choice.command)
    (choice.folder(root) / "table.md").write_text(text, encoding="utf-8")
    return text


def _standing(root: Path, choice: Rendering, name: str) -> ActionScore | None:
    """Numbers of an action that is not run now, where nothing of it has changed."""
    kept = _kept(root, choice, name)
    if not kept.is_file() or _stale(root, choice, name):
        return None
    return standing_score(_job(root, choice, name), kept)


def _stale(root: Path, choice: Rendering, name: str) -> bool:
    file = data_folder(root, "trials") / f"{name}.npz"
    key = key_of(name, file, choice.videos, choice.small)
    return not is_made(_action(root, choice, name), key)


def _job(root: Path, choice: Rendering, name: str) -> Job:
    return Workspace(choice.folder(root)).job(str(_action(root, choice, name)), [])


def _action(root: Path, choice: Rendering, name: str) -> Path:
    return choice.folder(root) / "actions" / name


def _kept(root: Path, choice: Rendering, name: str) -> Path:
    return choice.folder(root) / "scores" / f"{name}.json"
