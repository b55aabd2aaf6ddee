"""From a choice and an action's name to a job that can run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from benchmarks.actions.action_folder import action_key, is_made, make_action
from benchmarks.actions.captured import (
    RESAMPLED_MAX_RATE,
    Shot,
    data_folder,
    outlier_shot,
    protocol_shots,
    trial_shots,
)
from benchmarks.actions.choice import RESAMPLED, Choice
from imocap_core.errors import WrongUse
from imocap_core.pipeline.runner import Display, Job
from imocap_core.pipeline.source import closure
from imocap_core.workspace import Workspace


def action_names(root: Path, choice: Choice) -> list[str]:
    """Every action that the choice's data hold, whatever its `only`."""
    if choice.name == "yoga":
        return ["yoga"]
    if choice.name == "h36m":
        from benchmarks.actions.h36m import action_names as of_h36m

        return of_h36m(choice)
    return [file.stem for file in _files(root, choice)]


def chosen_names(root: Path, choice: Choice) -> list[str]:
    """The actions to run; WrongUse names one of `only` that there is not."""
    known = action_names(root, choice)
    unknown = [name for name in choice.only if name not in known]
    if unknown:
        raise WrongUse(f"--only {unknown[0]}: there are {', '.join(known)}")
    return [name for name in known if not choice.only or name in choice.only]


def ready_job(
    workspace: Workspace, choice: Choice, name: str, sets: Sequence[str], display: Display
) -> Job:
    """A job of an action; its folder is made first unless today's code made what is there."""
    if choice.name == "yoga":
        return workspace.ready_job("yoga", list(sets), display)
    folder, shots = _folder(workspace, choice, name), _shots(workspace.root, choice, name)
    make_action(
        folder, name, shots, choice.detector, _params(choice), _key(workspace, choice, name)
    )
    return Workspace(choice.folder(workspace.root)).ready_job(str(folder), list(sets), display)


def standing_job(
    workspace: Workspace, choice: Choice, name: str, sets: Sequence[str]
) -> Job | None:
    """The same without making anything; None when there is nothing or what is there is stale."""
    if choice.name == "yoga":
        made = (workspace.root / "actions" / "yoga").exists()
        return workspace.job("yoga", list(sets)) if made else None
    folder = _folder(workspace, choice, name)
    if not is_made(folder, _key(workspace, choice, name)):
        return None
    return Workspace(choice.folder(workspace.root)).job(str(folder), list(sets))


def _folder(workspace: Workspace, choice: Choice, name: str) -> Path:
    return choice.folder(workspace.root) / "actions" / name


def _params(choice: Choice) -> dict[str, Any]:
    return {"sync": {"max_rate": RESAMPLED_MAX_RATE}} if choice.name in RESAMPLED else {}


def _key(workspace: Workspace, choice: Choice, name: str) -> str:
    files = _inputs(workspace.root, choice, name)
    told = [choice.detector, choice.sampling, choice.videos, choice.outlier, _params(choice)]
    return action_key([closure(Path(__file__)), name, *told], files)


def _inputs(root: Path, choice: Choice, name: str) -> list[Path]:
    """The files that the action is made of."""
    if choice.name == "h36m":
        from benchmarks.actions.h36m import files_of

        return files_of(choice)
    own = data_folder(root, choice.name) / f"{name}.npz"
    return [own, _stranger(root, choice, name)] if choice.outlier else [own]


def _shots(root: Path, choice: Choice, name: str) -> Callable[[], Sequence[Shot]]:
    if choice.name == "h36m":
        from benchmarks.actions.h36m import shots_of

        return lambda: shots_of(choice, name)

    def made() -> list[Shot]:
        file, *strangers = _inputs(root, choice, name)
        if choice.name == "trials":
            shots = trial_shots(file, choice.videos)
        else:
            shots = protocol_shots(file, choice.sampling, choice.videos)
        return [*shots, *(outlier_shot(f, choice.name, choice.sampling) for f in strangers)]

    return made


def _stranger(root: Path, choice: Choice, name: str) -> Path:
    """Whose video the outlier is: the action half the list away, which is of another kind."""
    files = _files(root, choice)
    at = [file.stem for file in files].index(name)
    return files[(at + len(files) // 2) % len(files)]


def _files(root: Path, choice: Choice) -> list[Path]:
    return sorted(data_folder(root, choice.name).glob("*.npz"))
