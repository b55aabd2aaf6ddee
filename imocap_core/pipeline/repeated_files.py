"""One video file given twice."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path

from imocap_core.pipeline.action import Action, Declaration
from imocap_core.pipeline.content import content_digest


def repeated_files(action: Action) -> list[str]:
    """A sentence on every two videos that use the same frames of one file's content."""
    groups: dict[str, list[Declaration]] = defaultdict(list)
    for video in action.videos:
        if video.video is not None and (action.folder / video.video).is_file():
            groups[content_digest(action.folder / video.video)].append(video)
    return [
        f"{b.id} is the same file as {a.id}: it adds no view; remove one of them from {action.file}"
        for group in groups.values()
        for a, b in combinations(group, 2)
        if _overlap(a.frames, b.frames)
    ]


def repeated_paths(files: Sequence[Path]) -> list[str]:
    """A sentence on every two files of the same content."""
    digests = [content_digest(file) for file in files]
    return [
        f"{b} is the same file as {a}: it adds no view"
        for (a, first), (b, second) in combinations(zip(files, digests, strict=True), 2)
        if first == second
    ]


def _overlap(a: tuple[int, int] | None, b: tuple[int, int] | None) -> bool:
    """Whether two spans [first, one past last] of frames, None for all, have a frame in common."""
    return a is None or b is None or (a[0] < b[1] and b[0] < a[1])
