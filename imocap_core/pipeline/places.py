"""Where the files of videos lie when an action is taken along: inside its folder.

Results say where files lie in these terms, so that an action with videos anywhere and the same one
with them inside have results of the same digests.
"""

from __future__ import annotations

import posixpath
from collections.abc import Sequence
from pathlib import PureWindowsPath

from imocap_core.pipeline.action import DETECT, Declaration

FOLDERS = {"video": "videos", "keypoints": "keypoints", "initial": "initial"}  # by field


def leads_outside(given: str) -> bool:
    """Whether a path, as action.yaml has it, leads out of the action's folder."""
    path = PureWindowsPath(given)
    absolute = bool(path.drive) or path.as_posix().startswith("/")
    return absolute or posixpath.normpath(path.as_posix()).split("/")[0] == ".."


def placed(videos: Sequence[Declaration]) -> tuple[Declaration, ...]:
    """The declarations with all their files inside the action's folder; the rest as it is.

    A file from outside goes to the folder of its kind, under its name; where that place is taken by
    another one, the video's id comes before it.
    """
    given = [(v, field, path) for v in videos for field in FOLDERS if (path := _path(v, field))]
    taken = {_same(path): path for _, _, path in given if not leads_outside(path)}
    moved: dict[str, dict[str, str]] = {}
    for video, field, path in given:
        if leads_outside(path):
            name = PureWindowsPath(path).name
            place = f"{FOLDERS[field]}/{name}"
            while taken.setdefault(_same(place), path) != path:
                name = f"{video.id}_{name}"
                place = f"{FOLDERS[field]}/{name}"
            moved.setdefault(video.id, {})[field] = place
    return tuple(video.model_copy(update=moved.get(video.id, {})) for video in videos)


def _path(video: Declaration, field: str) -> str | None:
    path: str | None = getattr(video, field)
    return None if path == DETECT else path


def _same(path: str) -> str:
    """What two paths to one place have in common, on systems that do not tell a from A too."""
    return posixpath.normpath(PureWindowsPath(path).as_posix()).casefold()
