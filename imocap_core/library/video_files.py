"""The video files that a user names, one by one or by their folder."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from imocap_core.errors import WrongUse

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
