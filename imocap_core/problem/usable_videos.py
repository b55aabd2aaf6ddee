"""Videos that can be used: one whose declaration or files are wrong is left out, and named.

The others' result is then the one that they would have without it. Where fewer than two would
remain, all faults are one error: nobody who gave several videos wants the motion of one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TypeVar

from imocap_core.artifacts.schemas import LeftOutVideo

LEAST_VIDEOS = 2


Result = TypeVar("Result")
Faults = dict[str, str]  # video id -> what is wrong, and what to do


def of_usable(
    ids: Iterable[str], solve: Callable[[str], Result], faults: Faults
) -> dict[str, Result]:
    """`solve` of every video for which it raises no ValueError; the others go into `faults`.

    ValueError with all faults when too few videos remain.
    """
    results = {}
    for video in ids:
        try:
            results[video] = solve(video)
        except ValueError as error:
            faults[video] = str(error)
    if faults and len(results) < LEAST_VIDEOS:
        several = [f"{video}: {fault}" for video, fault in faults.items()]
        raise ValueError("\n".join(several if len(faults) > 1 else faults.values()))
    return results


def left_out_videos(
    faults: Mapping[str, str], names: Mapping[Path, str]
) -> list[LeftOutVideo] | None:
    """The videos with faults; None without any. names: how the action calls files and folders,
    because artifacts hold no absolute path."""
    videos = []
    for video, fault in faults.items():
        reason = "; ".join(fault.splitlines())
        for path in sorted(names, key=lambda p: len(str(p)), reverse=True):
            reason = reason.replace(str(path), names[path])
        videos.append(LeftOutVideo(id=video, reason=reason))
    return videos or None
