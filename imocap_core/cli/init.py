"""init: an action.yaml for some videos, ready to run."""

from __future__ import annotations

import os
import re
from pathlib import Path

import yaml

from imocap_core.errors import WrongUse
from imocap_core.pipeline.action import DETECT, FILE_NAME

HEAD = """\
# One performer, one action, one to many videos. Paths are relative to this folder.
# keypoints: detect finds people with MediaPipe (docs/detection.md). Or name what another detector
#   wrote: a folder of per-frame JSON files, or one file; it tells its format and layout itself.
# More fields (frames, focal_px, initial, truth, params): see docs/actions.md.
"""


def write_action(root: Path, name: str, videos: list[Path]) -> str:
    """Make root/actions/NAME/action.yaml and return what to do next.

    WrongUse when the name is no name, a video is missing, or the action exists.
    """
    if not re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.-]*", name):
        raise WrongUse(f"{name!r} is no name for an action: letters, digits, _ . - only")
    missing = [str(video) for video in videos if not video.is_file()]
    if missing:
        raise WrongUse(f"there is no video {', '.join(missing)}")
    folder = root / "actions" / name
    file = folder / FILE_NAME
    if file.exists():
        raise WrongUse(f"{file} exists already; edit it, or choose another name")
    folder.mkdir(parents=True, exist_ok=True)
    entries = [
        {"id": label, "video": _relative(video, folder), "keypoints": DETECT}
        for label, video in zip(_labels(videos), videos, strict=True)
    ]
    body = yaml.safe_dump({"name": name, "videos": entries}, sort_keys=False)
    file.write_text(HEAD + body, encoding="utf-8")
    return (
        f"Wrote {file}. Next: imocap run {name} (or make all ACTION={name}). The first run makes "
        "an environment for the detector, MediaPipe, which takes the network once."
    )


def _relative(video: Path, folder: Path) -> str:
    try:
        return Path(os.path.relpath(video.resolve(), folder.resolve())).as_posix()
    except ValueError:  # another drive
        return video.resolve().as_posix()


def _labels(videos: list[Path]) -> list[str]:
    """An id for each video: its file's name, or its number where that is no id or not unique."""
    stems = [re.sub(r"[^A-Za-z0-9_.-]", "_", video.stem) for video in videos]
    unique = len(set(stems)) == len(stems) and all(re.match(r"[A-Za-z0-9_]", s) for s in stems)
    return stems if unique else [f"v{i + 1}" for i in range(len(videos))]
