"""The files of an action: those that its action.yaml names, and itself."""

from __future__ import annotations

import os
from pathlib import Path

from imocap_core.errors import WorkFailed
from imocap_core.library.action_record import must_be_inside
from imocap_core.pipeline.action import DETECT, FILE_NAME, Action
from imocap_core.pipeline.graph import RunSettings
from imocap_core.workspace import check_files


def action_files(action: Action, settings: RunSettings) -> dict[str, Path]:
    """Path in the action's folder -> file; that of a folder ends with /.

    WorkFailed when one does not exist, or lies elsewhere: another machine has no such place.
    """
    check_files(action)
    named = [
        (f"videos.{i}.{field}", given)
        for i, video in enumerate(action.videos)
        for field in ("video", "keypoints", "initial")
        if (given := getattr(video, field)) not in (None, DETECT)
    ]
    named += [("truth", name) for name in action.truth_files]
    detect = settings.params.detect
    if any(video.detected for video in action.videos) and detect.detector == "rtmlib":
        models = {
            "rtmlib_person_model": detect.rtmlib_person_model,
            "rtmlib_pose_model": detect.rtmlib_pose_model,
        }
        named += [(f"params.detect.{n}", path) for n, path in models.items() if path is not None]
    files = {FILE_NAME: action.file}
    for field, given in named:
        files |= _entry(action, field, given)
    return files


def _entry(action: Action, field: str, given: str) -> dict[str, Path]:
    path = action.folder / given
    relative = Path(os.path.normpath(given)).as_posix()
    try:
        must_be_inside(relative)
    except ValueError:
        raise WorkFailed(
            f"{action.file}: {field}: {given} lies outside the action's folder, and has no place "
            "on another machine; move it into the folder, or make a link to it there, and name that"
        ) from None
    return {relative + "/" if path.is_dir() else relative: path}
