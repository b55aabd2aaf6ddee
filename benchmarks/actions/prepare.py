"""Real videos that come with a calibrated system's answer, as action folders.

*balance_beam* has OpenPose's keypoints, *crowd* none. Variants declare the same videos otherwise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from shutil import copyfile
from typing import Any

import yaml

from benchmarks.actions.action_folder import MADE, action_key, is_made, make_action, make_whole
from benchmarks.actions.captured_videos import (
    CapturedVideo,
    Choice,
    data_folder,
    outlier_video,
    protocol_videos,
    trial_videos,
)
from imocap_core.errors import WrongUse
from imocap_core.pipeline.action import DETECT, FILE_NAME
from imocap_core.pipeline.runner import Display, Job
from imocap_core.pipeline.source import closure
from imocap_core.pipeline.yaml_file import load_yaml
from imocap_core.workspace import Workspace

EVENT, PIXELS = "_event", "_pixels"
REAL = ("balance_beam", f"balance_beam{EVENT}", f"balance_beam{PIXELS}", "crowd")


def real_source(root: Path, name: str) -> Path:
    """The folder of the data that a variant is made of; WorkFailed when it is not here."""
    return data_folder(root, name.removesuffix(EVENT).removesuffix(PIXELS))


def source_files(source: Path) -> list[Path]:
    """All files of an action's folder but the mark of how it was made."""
    return sorted(file for file in source.rglob("*") if file.is_file() and file.name != MADE)


def make_real(folder: Path, source: Path, key: str) -> None:
    """The source's files with the declarations of the variant that `folder` is named after."""

    def write(new: Path) -> None:
        for file in source_files(source):
            copy_file(source, new, file.relative_to(source).as_posix())
        action = load_yaml(source / FILE_NAME) | {"name": folder.name}
        if folder.name.endswith(EVENT):
            action["event"] = True
        if folder.name.endswith(PIXELS):
            action["videos"] = [detected_declaration(video) for video in action["videos"]]
        (new / FILE_NAME).write_text(yaml.safe_dump(action, sort_keys=False))

    make_whole(folder, key, write)


def copy_file(source: Path, folder: Path, name: str) -> None:
    """A file, by its path in the action's folder; its bytes alone, as data may be read-only."""
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    copyfile(source / name, folder / name)


def detected_declaration(declared: dict[str, Any]) -> dict[str, Any]:
    """A video's declaration with keypoints to be detected, whatever it says."""
    plain = {k: v for k, v in declared.items() if k not in ("format", "layout")}
    return plain | {"keypoints": DETECT}


# From a choice and an action's name to a job that can run.


def action_names(root: Path, choice: Choice) -> list[str]:
    """Every action of the choice's data, whatever its `only`."""
    if choice.name == "yoga":
        return ["yoga"]
    if choice.name == "real":
        return list(REAL)
    if choice.name == "h36m":
        from benchmarks.actions.h36m import h36m_actions

        return h36m_actions(choice)
    return [file.stem for file in _files(root, choice)]


def chosen_names(root: Path, choice: Choice) -> list[str]:
    """The actions to run; WrongUse when `only` names an action that does not exist."""
    available = action_names(root, choice)
    unknown = [name for name in choice.only if name not in available]
    if unknown:
        raise WrongUse(f"--only {unknown[0]}: expected one of {', '.join(available)}")
    return [name for name in available if not choice.only or name in choice.only]


def ready_job(
    workspace: Workspace, choice: Choice, name: str, sets: Sequence[str], display: Display
) -> Job:
    """A job of an action; its folder is made first unless the same code and data made it."""
    if choice.name == "yoga":
        return workspace.ready_job("yoga", list(sets), display)
    folder, key = _folder(workspace, choice, name), _key(workspace, choice, name)
    if choice.name == "real":
        make_real(folder, real_source(workspace.root, name), key)
    else:
        videos = _videos(workspace.root, choice, name)
        make_action(folder, name, videos, choice.detector, {}, key)
    return Workspace(choice.folder(workspace.root)).ready_job(str(folder), list(sets), display)


def existing_job(
    workspace: Workspace, choice: Choice, name: str, sets: Sequence[str]
) -> Job | None:
    """A job of an action without making anything; None when its folder is missing or stale."""
    if choice.name == "yoga":
        made = (workspace.root / "actions" / "yoga").exists()
        return workspace.job("yoga", list(sets)) if made else None
    folder = _folder(workspace, choice, name)
    if not is_made(folder, _key(workspace, choice, name)):
        return None
    return Workspace(choice.folder(workspace.root)).job(str(folder), list(sets))


def _folder(workspace: Workspace, choice: Choice, name: str) -> Path:
    return choice.folder(workspace.root) / "actions" / name


def _key(workspace: Workspace, choice: Choice, name: str) -> str:
    files = _inputs(workspace.root, choice, name)
    inputs = [choice.detector, choice.sampling, choice.videos, choice.outlier]
    return action_key([closure(Path(__file__)), name, *inputs], files)


def _inputs(root: Path, choice: Choice, name: str) -> list[Path]:
    """The files that the action is made of."""
    if choice.name == "h36m":
        from benchmarks.actions.h36m import h36m_files

        return h36m_files(choice)
    if choice.name == "real":
        return source_files(real_source(root, name))
    file = data_folder(root, choice.name) / f"{name}.npz"
    return [file, _outlier_file(root, choice, name)] if choice.outlier else [file]


def _videos(root: Path, choice: Choice, name: str) -> Callable[[], Sequence[CapturedVideo]]:
    if choice.name == "h36m":
        from benchmarks.actions.h36m import h36m_videos

        return lambda: h36m_videos(choice, name)

    def made() -> list[CapturedVideo]:
        file, *outliers = _inputs(root, choice, name)
        if choice.name == "trials":
            videos = trial_videos(file, choice.videos)
        else:
            videos = protocol_videos(file, choice.sampling, choice.videos)
        return [*videos, *(outlier_video(f, choice.name, choice.sampling) for f in outliers)]

    return made


def _outlier_file(root: Path, choice: Choice, name: str) -> Path:
    """The action half the list away, which is of another kind; the outlier is a video of it."""
    files = _files(root, choice)
    index = [file.stem for file in files].index(name)
    return files[(index + len(files) // 2) % len(files)]


def _files(root: Path, choice: Choice) -> list[Path]:
    return sorted(data_folder(root, choice.name).glob("*.npz"))
