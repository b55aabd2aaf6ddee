"""An action.yaml for some videos, or for the occurrences of a movement in long videos."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from imocap_core.errors import WrongUse
from imocap_core.files import write_whole
from imocap_core.identifiers import NAME
from imocap_core.library.api_errors import Params, Progress, displaying, one_off, plain_errors
from imocap_core.pipeline.action import (
    DETECT,
    FILE_NAME,
    check_name,
    declared_path,
    read_action,
    repeated_paths,
)
from imocap_core.pipeline.builtin_actions import BUILT_IN
from imocap_core.pipeline.yaml_file import edited_text
from imocap_core.sync_sources import VideoSource, ascii_name, labels
from imocap_core.workspace import Workspace, is_action

if TYPE_CHECKING:
    from imocap_core.collect.listing import CollectedList


VIDEO_SUFFIXES = (".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v", ".mts", ".mpg", ".mpeg", ".3gp")
OWN_FOLDERS = ("actions", "artifacts")
FEW = 3


def video_files(paths: Sequence[Path]) -> tuple[list[Path], list[str]]:
    """Files that can be captured from, and a sentence on every other file of a folder among paths.

    WrongUse without paths, and with a line for every file named that is no video that can be used
    and every folder without any.
    """
    if not paths:
        raise WrongUse("expected at least one video, or folder of videos, got none")
    files: list[Path] = []
    remarks: list[str] = []
    faults: list[str] = []
    for path in paths:
        if path.is_dir():
            videos, others = _videos_in(path)
            if not videos:
                faults.append(
                    "\n".join([f"{path}: expected videos in the folder, got none", *others])
                )
            files += videos
            remarks += others
        elif path.is_file():
            fault = _fault(path)
            files += [] if fault else [path]
            faults += [fault] if fault else []
        else:
            faults.append(f"there is no video {path}")
    if faults:
        raise WrongUse("\n".join(faults))
    return files, remarks


def _videos_in(folder: Path) -> tuple[list[Path], list[str]]:
    """The videos of a folder and of the folders in it, in the order of their names, numbers as
    numbers; and a sentence on every other file with a video's suffix and one on the rest."""
    faults = {file: _fault(file) for file in files_below(folder)}
    videos = [file for file, fault in faults.items() if fault is None]
    left = {file: fault for file, fault in faults.items() if fault is not None}
    others = [file for file in left if file.suffix.lower() not in VIDEO_SUFFIXES]
    if len(others) < FEW:
        return videos, [f"left out: {fault}" for fault in left.values()]
    names = ", ".join(file.name for file in others[:FEW])
    more = f" and {len(others) - FEW} more" if len(others) > FEW else ""
    broken = [f"left out: {fault}" for file, fault in left.items() if file not in others]
    return videos, [*broken, f"left out, as no videos: {names}{more}"]


def files_below(folder: Path) -> list[Path]:
    """The files of a folder and of the folders in it, in the order of their names. What is hidden,
    actions/ and artifacts/, where this program writes films, and linked folders are passed over."""
    files = []
    for path in sorted(folder.iterdir(), key=_natural_order):
        if path.name.startswith("."):
            continue
        if path.is_file():
            files.append(path)
        elif path.is_dir() and not path.is_symlink() and path.name not in OWN_FOLDERS:
            files += files_below(path)
    return files


def _fault(file: Path) -> str | None:
    from imocap_core.io.frame_access import check_video

    try:
        check_video(file)
    except (ValueError, OSError) as error:
        return str(error)
    return None


def _natural_order(file: Path) -> list[tuple[int, str]]:
    """clip2 before clip10."""
    parts = re.findall(r"\d+|\D+", file.name.lower())
    return [(int(part) if part.isdigit() else -1, part) for part in parts]


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
    words = _in_words(files)
    remarks += [*repeated_paths(files), *([f"The videos{words}."] if words else [])]
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

    paths: files, or folders of files; an action of one folder is named after it. The action of
        folders takes clips that have come, and drops those that have gone.

    WrongUse when a file cannot be used, or another action has the name.
    """
    files, remarks = video_files(paths)
    name = name_of(paths, files) if name is None else _valid(name)
    folder = root / "actions" / name
    if not (folder / FILE_NAME).is_file():
        _write_action(name, folder, files)
        return name, [*remarks, f"Wrote {folder / FILE_NAME}{_in_words(files)}."]
    declared = {v.id: v.video for v in read_action(folder).videos}
    places = {i: (folder / v).resolve() for i, v in declared.items() if v is not None}
    given = {file.resolve(): file for file in files}
    elsewhere = [i for i in declared if i not in places or places[i] not in given]
    gone = [i for i in elsewhere if i in places and not places[i].is_file()]
    fresh = [file for place, file in given.items() if place not in places.values()]
    if not elsewhere and not fresh:
        return name, remarks
    if gone != elsewhere or not all(path.is_dir() for path in paths):
        raise WrongUse(f"{folder / FILE_NAME} is of other videos; choose another name")
    return name, [*remarks, _updated(folder, fresh, gone, [*declared])]


def _updated(folder: Path, fresh: Sequence[Path], gone: Sequence[str], ids: Sequence[str]) -> str:
    """Declare new videos in an action.yaml, and those no longer that are gone; all else in it
    stays. A sentence on both; ids: all that are declared."""
    entries = [
        {"id": i, "video": declared_path(file, folder), "keypoints": DETECT}
        for i, file in zip(free_labels(fresh, ids), fresh, strict=True)
    ]

    def change(content: Any) -> None:
        for n in reversed(range(len(ids))):
            if ids[n] in gone:
                del content["videos"][n]
        content["videos"].extend(entries)

    text = (folder / FILE_NAME).read_text(encoding="utf-8")
    write_whole(folder / FILE_NAME, edited_text(text, change))
    changes = [f"+{entry['id']}" for entry in entries] + [f"-{i}" for i in gone]
    return f"{folder / FILE_NAME}: {' '.join(changes)}, as the folder has changed."


def action_of_words(root: Path, words: Sequence[str], name: str | None) -> tuple[str, list[str]]:
    """The one action named, or that of the videos and folders named; and remarks on files.

    With a name the words are videos and folders.
    """
    actions = [word for word in words if name is None and is_action(root, word)]
    if actions and len(words) > 1:
        raise WrongUse(f"{actions[0]} is an action: give it alone")
    file = Path(words[0]) if len(words) == 1 else None
    missing = file and not file.exists() and file.suffix.lower() not in VIDEO_SUFFIXES
    if actions or (name is None and missing):
        valid = ascii_name(words[0])  # `init "my serve"` makes my_serve
        return (valid if not actions and is_action(root, valid) else words[0]), []
    return action_of_videos(root, name, [Path(word) for word in words])


def name_of(paths: Sequence[Path], files: Sequence[Path]) -> str:
    """A folder's name; of files their common beginning, and letters that differ for others."""
    from imocap_core.standalone_sync import default_name

    if len(paths) == 1 and paths[0].is_dir():
        words = ascii_name(paths[0].resolve().name).lstrip("_")
        if words and words not in BUILT_IN:
            return words
    named = [VideoSource(file, None) for file in files]
    return default_name("", labels(named), named)


@dataclass(frozen=True)
class CollectedAction:
    """What `collect` made: the list of all shots and occurrences, and the files.

    action_file and list_file are None where nothing was to be written. remarks: on the files.
    """

    listing: CollectedList
    action_file: Path | None
    list_file: Path | None
    remarks: tuple[str, ...] = ()


@plain_errors
def collect(
    name: str,
    videos: Sequence[str | Path],
    *,
    example: tuple[str | Path, float, float] | None = None,
    keep: int | None = None,
    dry_run: bool = False,
    root: str | Path = ".",
    params: Params = None,
    progress: Progress = None,
) -> CollectedAction:
    """Make root/actions/NAME of the occurrences of one movement in long videos.

    Args:
        videos: films of many shots, or folders of them, in which what is no video is left out.
        example: a video that shows the movement, and from and to in seconds; else the movement
            that is repeated most.
        keep: most occurrences that become videos; else `collect.keep`.
        dry_run: only say what would be taken.
        params: one-off parameters, as {"collect.least_contrast": 1.5}.

    Raises:
        WrongUse: the name is invalid or taken, a video is missing, the example is not in its video.
        WorkFailed: a video cannot be decoded, or nothing is found.
    """
    from imocap_core.collect.collect import collect_films
    from imocap_core.collect.listing import FILE_NAME as LIST_NAME
    from imocap_core.collect.listing import write_action, write_collected
    from imocap_core.collect.movement import Example
    from imocap_core.pipeline.graph import settings

    check_name(name)
    files, remarks = video_files([Path(video) for video in videos])
    source = None if example is None else Example(Path(example[0]), example[1], example[2])
    if source is not None and video_files([source.video])[0] != [source.video]:
        raise WrongUse(f"{source.video}: expected the video of the example, got a folder")
    remarks = [*remarks, *repeated_paths(files)]
    workspace = Workspace(Path(root))
    folder = workspace.root / "actions" / name
    if (folder / FILE_NAME).exists() and not dry_run:
        raise WrongUse(f"{folder / FILE_NAME} exists already; edit it, or choose another name")
    pipeline = workspace.pipeline()
    sets = [*one_off(params), *([f"collect.keep={keep}"] if keep is not None else [])]
    chosen = settings(pipeline, {}, pipeline.file, sets).params
    with displaying(progress) as display:
        listing, alone = collect_films(workspace, name, files, source, chosen, folder, display)
    if dry_run or not listing.chosen:
        return CollectedAction(listing, None, None, tuple(remarks))
    folder.mkdir(parents=True, exist_ok=True)
    write_collected(folder / LIST_NAME, listing)
    action_file = write_action(folder, listing, alone)
    return CollectedAction(listing, action_file, folder / LIST_NAME, tuple(remarks))
