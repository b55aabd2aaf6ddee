"""An action.yaml for some videos, ready to run."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import yaml

from imocap_core.errors import WrongUse
from imocap_core.identifiers import NAME
from imocap_core.library.door import plain_errors
from imocap_core.library.video_files import video_files
from imocap_core.pipeline.action import DETECT, FILE_NAME, check_name, read_action
from imocap_core.pipeline.builtin_actions import BUILT_IN
from imocap_core.pipeline.declared_paths import declared_path
from imocap_core.pipeline.repeated_files import repeated_paths
from imocap_core.standalone_sync.sources import VideoSource, ascii_name, labels
from imocap_core.whole_files import write_whole

HEAD = """\
# One action, one to many videos. Paths are relative to this folder.
# keypoints: detect finds people with BlazePose (docs/detection.md). Or name what another detector
#   wrote: a folder of per-frame JSON files, or one file; it tells its format and layout itself.
# More fields (frames, focal_px, performer, event, truth, ...): see docs/actions.md.
"""


@plain_errors
def init_action(name: str, videos: Sequence[str | Path], *, root: str | Path = ".") -> Path:
    """Make root/actions/NAME/action.yaml for some videos of one action; its path.

    Args:
        videos: files, or folders of files, in which what is no video is left out.

    WrongUse when the name is invalid, a file cannot be used, or the action exists.
    """
    return new_action(name, [Path(video) for video in videos], Path(root)).file


@dataclass(frozen=True)
class NewAction:
    """Its name and action.yaml, the videos declared in it, and sentences for the user."""

    name: str
    file: Path
    videos: list[Path]
    remarks: list[str]


@plain_errors
def new_action(name: str, paths: Sequence[Path], root: Path) -> NewAction:
    """As `init_action`, with what is to be told about the files."""
    name = _valid(name)
    folder = root / "actions" / name
    action_file = folder / FILE_NAME
    if action_file.exists():
        raise WrongUse(f"{action_file} exists already; edit it, or choose another name")
    files, remarks = video_files(paths)
    _write_action(name, folder, files)
    remarks = [*remarks, *repeated_paths(files), *_which_is_which(files)]
    return NewAction(name, action_file, files, remarks)


def _valid(name: str) -> str:
    """The name, spaces and accents replaced. WrongUse where that is not enough."""
    if not re.fullmatch(NAME, name) and not {"/", "\\"} & set(name):
        name = ascii_name(name) or name
    check_name(name)
    return name


def free_labels(files: Sequence[Path], taken: Sequence[str]) -> list[str]:
    """An id for each of further videos of an action: its name, or the next free number."""
    ids: list[str] = []
    for file in files:
        used = {i.lower() for i in (*taken, *ids)}
        name = ascii_name(file.stem)
        numbers = (f"v{n}" for n in count(1))
        ids.append(name if name and name.lower() not in used else next(numbers))
        while ids[-1].lower() in used:
            ids[-1] = next(numbers)
    return ids


def _which_is_which(files: Sequence[Path]) -> list[str]:
    """A sentence on files whose ids are other than their names."""
    words = _in_words(files)
    return [f"The videos{words}."] if words else []


def _in_words(files: Sequence[Path]) -> str:
    """': v1 is X.mp4, ...' where ids do not say it; else nothing."""
    ids = labels([VideoSource(file, None) for file in files])
    if ids == [ascii_name(file.stem) for file in files]:
        return ""
    return ": " + ", ".join(f"{i} is {file.name}" for i, file in zip(ids, files, strict=True))


def _write_action(name: str, folder: Path, files: Sequence[Path]) -> None:
    sources = [VideoSource(file, None) for file in files]
    folder.mkdir(parents=True, exist_ok=True)
    entries = [
        {"id": label, "video": declared_path(file, folder), "keypoints": DETECT}
        for label, file in zip(labels(sources), files, strict=True)
    ]
    body = yaml.safe_dump({"name": name, "videos": entries}, sort_keys=False)
    write_whole(folder / FILE_NAME, HEAD + body)


@plain_errors
def action_of_videos(root: Path, name: str | None, paths: Sequence[Path]) -> tuple[str, list[str]]:
    """The name of the action of just these videos, made when there is none; and remarks on files.

    paths: files, or folders of files; an action of one folder is named after it.

    WrongUse when a file cannot be used, or another action has the name.
    """
    files, remarks = video_files(paths)
    name = name_of(paths, files) if name is None else _valid(name)
    folder = root / "actions" / name
    if not (folder / FILE_NAME).is_file():
        _write_action(name, folder, files)
        return name, [*remarks, f"Wrote {folder / FILE_NAME}{_in_words(files)}."]
    declared = [v.video for v in read_action(folder).videos]
    there = [None if v is None else (folder / v).resolve() for v in declared]
    if there != [file.resolve() for file in files]:
        raise WrongUse(f"{folder / FILE_NAME} is of other videos; choose another name")
    return name, remarks


def action_of_words(root: Path, words: Sequence[str], name: str | None) -> tuple[str, list[str]]:
    """The one action named, or that of the videos and folders named; and remarks on files.

    With a name the words are videos and folders.
    """
    actions = [word for word in words if name is None and _is_action(root, word)]
    if actions and len(words) > 1:
        raise WrongUse(f"{actions[0]} is an action: give it alone")
    if actions or (name is None and len(words) == 1 and not Path(words[0]).exists()):
        valid = ascii_name(words[0])  # `init "my serve"` makes my_serve
        return (valid if not actions and _is_action(root, valid) else words[0]), []
    return action_of_videos(root, name, [Path(word) for word in words])


def _is_action(root: Path, word: str) -> bool:
    places = (root / "actions" / word / FILE_NAME, Path(word) / FILE_NAME)
    return word in BUILT_IN or Path(word).name == FILE_NAME or any(p.is_file() for p in places)


def name_of(paths: Sequence[Path], files: Sequence[Path]) -> str:
    """A folder's name; of files their common beginning, and letters that differ for others."""
    from imocap_core.standalone_sync.action import default_name

    if len(paths) == 1 and paths[0].is_dir():
        words = ascii_name(paths[0].resolve().name).lstrip("_")
        if words and words not in BUILT_IN:
            return words
    named = [VideoSource(file, None) for file in files]
    return default_name("", labels(named), named)
