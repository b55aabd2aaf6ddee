"""An action.yaml for some videos, ready to run."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import yaml

from imocap_core.errors import WrongUse
from imocap_core.library.door import plain_errors
from imocap_core.pipeline.action import DETECT, FILE_NAME, check_name, read_action
from imocap_core.pipeline.repeated_files import repeated_paths
from imocap_core.standalone_sync.sources import VideoSource, labels
from imocap_core.whole_files import write_whole

HEAD = """\
# One performer, one action, one to many videos. Paths are relative to this folder.
# keypoints: detect finds people with BlazePose (docs/detection.md). Or name what another detector
#   wrote: a folder of per-frame JSON files, or one file; it tells its format and layout itself.
# More fields (frames, focal_px, initial, truth, params): see docs/actions.md.
"""


@plain_errors
def init_action(name: str, videos: Sequence[str | Path], *, root: str | Path = ".") -> Path:
    """Make root/actions/NAME/action.yaml for some video files of one action; its path.

    WrongUse when the name is invalid, a video is missing, or the action exists.
    """
    files = [Path(video) for video in videos]
    sources = [VideoSource(file, None) for file in files]
    check_name(name)
    missing = [str(file) for file in files if not file.is_file()]
    if missing:
        raise WrongUse(f"there is no video {', '.join(missing)}")
    folder = Path(root) / "actions" / name
    action_file = folder / FILE_NAME
    if action_file.exists():
        raise WrongUse(f"{action_file} exists already; edit it, or choose another name")
    folder.mkdir(parents=True, exist_ok=True)
    entries = [
        {"id": label, "video": _relative(file, folder), "keypoints": DETECT}
        for label, file in zip(labels(sources), files, strict=True)
    ]
    body = yaml.safe_dump({"name": name, "videos": entries}, sort_keys=False)
    write_whole(action_file, HEAD + body)
    return action_file


@plain_errors
def repetitions_of(videos: Sequence[str | Path]) -> list[str]:
    """A sentence on every two files of the same content."""
    return repeated_paths([Path(video) for video in videos])


def action_of_videos(root: Path, name: str | None, videos: Sequence[Path]) -> str:
    """The name of the action of just these videos, made when there is none.

    WrongUse when another action has the name.
    """
    from imocap_core.standalone_sync.action import default_name

    if name is None:
        named = [VideoSource(video, None) for video in videos]
        name = default_name("", labels(named), named)
    folder = root / "actions" / name
    if (folder / FILE_NAME).is_file():
        declared = [v.video for v in read_action(folder).videos]
        there = [None if v is None else (folder / v).resolve() for v in declared]
        if there != [video.resolve() for video in videos]:
            raise WrongUse(f"{folder / FILE_NAME} is of other videos; choose another name")
    else:
        init_action(name, videos, root=root)
    return name


def _relative(video: Path, folder: Path) -> str:
    try:
        return Path(os.path.relpath(video.resolve(), folder.resolve())).as_posix()
    except ValueError:  # another drive
        return video.resolve().as_posix()
