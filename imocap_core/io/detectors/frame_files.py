"""A folder with one file of keypoints a frame: which file is of which frame."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from imocap_core.io.detectors.people import read_json


def frame_files(folder: Path, suffix: str = ".json") -> list[Path]:
    """Its files in the order of their names, without hidden ones (macOS writes ``._NAME``)."""
    return sorted(f for f in folder.glob(f"*{suffix}") if not f.name.startswith("."))


def numbered_files(folder: Path, suffix: str = ".json", what: str = "OpenPose") -> dict[int, Path]:
    """Frame number -> file; the number is the last one in the name. ValueError where a name has
    none, a number has two files, or there is no file."""
    files: dict[int, Path] = {}
    for file in frame_files(folder, suffix):
        numbers = re.findall(r"\d+", file.stem)
        if not numbers:
            raise ValueError(
                f"{file}: expected a frame number in the file name, got none; "
                f"name the files like clip_000000000012_keypoints{suffix}"
            )
        number = int(numbers[-1])
        if number in files:
            raise ValueError(
                f"{folder}: frame {number} has two files, {files[number].name} and {file.name}; "
                "keep one clip per folder"
            )
        files[number] = file
    if not files:
        raise ValueError(
            f"{folder}: expected one {what} file per frame, found no {suffix} file; check "
            f"`keypoints` in action.yaml"
        )
    return dict(sorted(files.items()))


def numbered_contents(folder: Path, what: str) -> Iterator[tuple[int, Any, str]]:
    """(frame number, content, file) of a folder of JSON files."""
    for number, file in numbered_files(folder, what=what).items():
        yield number, read_json(file), str(file)
