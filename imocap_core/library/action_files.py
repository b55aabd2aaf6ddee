"""The files of an action: those that its action.yaml names, and itself."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from imocap_core.errors import WorkFailed
from imocap_core.library.action_record import must_be_inside
from imocap_core.pipeline.action import DETECT, FILE_NAME, Action, Declaration
from imocap_core.pipeline.edited_yaml import edited_text
from imocap_core.pipeline.graph import RunSettings
from imocap_core.pipeline.places import FOLDERS, placed
from imocap_core.workspace import check_files


def action_files(action: Action, settings: RunSettings) -> dict[str, Path]:
    """Path in the action's folder -> file; that of a folder ends with /.

    WorkFailed when one does not exist, or lies elsewhere.
    """
    return _files(action, settings, action.videos)


def portable_files(action: Action, settings: RunSettings, aside: Path) -> dict[str, Path]:
    """As `action_files`, with files of videos that lie elsewhere where they belong in the folder.

    Args:
        aside: a folder for the action.yaml that names these places, with its comments and all else
            as they are; it is written where it differs.

    WorkFailed when a file does not exist, or has no place on another machine.
    """
    videos = placed(action.videos)
    files = _files(action, settings, videos)
    if videos != action.videos:
        text = action.file.read_bytes().decode("utf-8")
        files[FILE_NAME] = aside / FILE_NAME
        files[FILE_NAME].write_bytes(_with_places(text, videos).encode("utf-8"))
    return files


def _files(action: Action, settings: RunSettings, videos: Sequence[Declaration]) -> dict[str, Path]:
    check_files(action)
    files = {FILE_NAME: action.file}
    for field, given, place in _named(action, settings, videos):
        files |= _entry(action, field, given, place)
    return files


def _named(
    action: Action, settings: RunSettings, videos: Sequence[Declaration]
) -> Iterator[tuple[str, str, str]]:
    """Field of action.yaml, path as it has it, and the place in the folder, as in `videos`."""
    for i, (video, there) in enumerate(zip(action.videos, videos, strict=True)):
        for field in FOLDERS:
            given = getattr(video, field)
            if given not in (None, DETECT):
                yield f"videos.{i}.{field}", given, getattr(there, field)
    for name in action.truth_files:
        yield "truth", name, name
    detect = settings.params.detect
    if any(video.detected for video in action.videos) and detect.detector == "rtmlib":
        models = {
            "rtmlib_person_model": detect.rtmlib_person_model,
            "rtmlib_pose_model": detect.rtmlib_pose_model,
        }
        for name, path in models.items():
            if path is not None:
                yield f"params.detect.{name}", path, path


def _entry(action: Action, field: str, given: str, place: str) -> dict[str, Path]:
    path = action.folder / given
    relative = Path(os.path.normpath(place)).as_posix()
    try:
        must_be_inside(relative)
    except ValueError:
        raise WorkFailed(
            f"{action.file}: {field}: {given} lies outside the action's folder, or has a name that "
            "other systems do not take, and so has no place on another machine; move it into the "
            "folder under a plain name, or make a link to it there, and name that"
        ) from None
    return {relative + "/" if path.is_dir() else relative: path}


def _with_places(text: str, videos: Sequence[Declaration]) -> str:
    """An action.yaml that names the files of its videos where `videos` has them."""

    def change(content: Any) -> None:
        for entry, video in zip(content["videos"], videos, strict=True):
            for field in FOLDERS:
                place = getattr(video, field)
                if place is not None and entry[field] != place:
                    entry[field] = place

    return edited_text(text, change)
