"""A folder that fills: an action of its videos, run again whenever clips have come or gone."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from imocap_core.errors import ImocapError
from imocap_core.files import write_whole
from imocap_core.library import new_action
from imocap_core.library.result import Result, load
from imocap_core.pipeline.action import DETECT, FILE_NAME, declared_path, read_action
from imocap_core.pipeline.yaml_file import edited_text
from imocap_core.report.first_page import compared as compared

POLL_S = 2.0
Listing = list[tuple[Path, int, int]]


def settled_changes(folder: Path, wait: Callable[[float], object] = time.sleep) -> Iterator[None]:
    """Yields whenever the folder's files are other than at the last yield, and none has grown
    for a moment: a clip that is still being copied is waited for."""
    announced: Listing = []
    before: Listing = []
    while True:
        now = _listing(folder)
        if now == before and now != announced:
            announced = now
            yield
        before = now
        wait(POLL_S)


def _listing(folder: Path) -> Listing:
    files = []
    for file in new_action.files_below(folder):
        try:
            status = file.stat()
        except OSError:
            continue  # it has gone meanwhile
        files.append((file, status.st_size, status.st_mtime_ns))
    return files


def bring_up_to_date(root: Path, folder: Path, name: str | None) -> str:
    """Make the action of a folder's videos, or add to it those that are new and remove those that
    are gone; all else in action.yaml stays. Returns its name. WrongUse while there is no video."""
    files, _ = new_action.video_files([folder])
    name = new_action.name_of([folder], files) if name is None else name
    if not (root / "actions" / name / FILE_NAME).is_file():
        return new_action.action_of_videos(root, name, [folder])[0]
    place = root / "actions" / name
    declared = {v.id: v.video for v in read_action(place).videos}
    there = {file.resolve(): file for file in files}
    declared_paths = {i: (place / v).resolve() for i, v in declared.items() if v is not None}
    gone = [i for i, path in declared_paths.items() if not path.is_file()]
    fresh = [file for path, file in there.items() if path not in declared_paths.values()]
    ids = new_action.free_labels(fresh, [i for i in declared if i not in gone])
    entries = [
        {"id": i, "video": declared_path(file, place), "keypoints": DETECT}
        for i, file in zip(ids, fresh, strict=True)
    ]

    def change(content: Any) -> None:
        for n in reversed(range(len(content["videos"]))):
            if content["videos"][n]["id"] in gone:
                del content["videos"][n]
        content["videos"].extend(entries)

    if gone or entries:
        text = (place / FILE_NAME).read_text(encoding="utf-8")
        write_whole(place / FILE_NAME, edited_text(text, change))
    return name


def last_result(root: Path, action: str) -> Result | None:
    """The result of the action's last run."""
    try:
        return load(root / "artifacts" / action)
    except ImocapError:
        return None
