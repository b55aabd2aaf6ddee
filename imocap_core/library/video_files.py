"""The video files that a user names, one by one or by their folder."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from imocap_core.errors import WrongUse


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
    """The videos of a folder in the order of their names, numbers as numbers; hidden files and
    folders in it are passed over."""
    files = [f for f in folder.iterdir() if f.is_file() and not f.name.startswith(".")]
    faults = {file: _fault(file) for file in sorted(files, key=_natural_order)}
    videos = [file for file, fault in faults.items() if fault is None]
    return videos, [f"left out: {fault}" for fault in faults.values() if fault is not None]


def _fault(file: Path) -> str | None:
    from imocap_core.io.video_check import check_video

    try:
        check_video(file)
    except (ValueError, OSError) as error:
        return str(error)
    return None


def _natural_order(file: Path) -> list[tuple[int, str]]:
    """clip2 before clip10."""
    parts = re.findall(r"\d+|\D+", file.name.lower())
    return [(int(part) if part.isdigit() else -1, part) for part in parts]
