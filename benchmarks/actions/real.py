"""Real videos that come with a calibrated system's answer, as action folders.

*balance_beam* has OpenPose's keypoints, *crowd* none. Variants declare the same videos otherwise.
"""

from __future__ import annotations

from pathlib import Path
from shutil import copyfile
from typing import Any

import yaml

from benchmarks.actions.action_folder import MADE, make_whole
from benchmarks.actions.captured import data_folder
from imocap_core.pipeline.action import DETECT, FILE_NAME
from imocap_core.pipeline.yaml_file import load_yaml

EVENT, PIXELS = "_event", "_pixels"
REAL = ("balance_beam", f"balance_beam{EVENT}", f"balance_beam{PIXELS}", "crowd")


def real_source(root: Path, name: str) -> Path:
    """The folder of the data that a variant is made of; WorkFailed when it is not here."""
    return data_folder(root, name.removesuffix(EVENT).removesuffix(PIXELS))


def source_files(source: Path) -> list[Path]:
    """All files of an action's folder but the mark of how it was made."""
    return sorted(file for file in source.rglob("*") if file.is_file() and file.name != MADE)


def make_real(folder: Path, source: Path, key: str) -> None:
    """The source's files with the declarations of the variant that `folder` is named after."""

    def write(new: Path) -> None:
        for file in source_files(source):
            copy_file(source, new, file.relative_to(source).as_posix())
        action = load_yaml(source / FILE_NAME) | {"name": folder.name}
        if folder.name.endswith(EVENT):
            action["event"] = True
        if folder.name.endswith(PIXELS):
            action["videos"] = [detected_declaration(video) for video in action["videos"]]
        (new / FILE_NAME).write_text(yaml.safe_dump(action, sort_keys=False))

    make_whole(folder, key, write)


def copy_file(source: Path, folder: Path, name: str) -> None:
    """A file, by its path in the action's folder; its bytes alone, as data may be read-only."""
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    copyfile(source / name, folder / name)


def detected_declaration(declared: dict[str, Any]) -> dict[str, Any]:
    """A video's declaration with keypoints to be detected, whatever it says."""
    plain = {k: v for k, v in declared.items() if k not in ("format", "layout")}
    return plain | {"keypoints": DETECT}
