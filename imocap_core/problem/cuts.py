"""Cuts between the shots of a video, and advice about them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Int

from imocap_core.io.video import read_gray
from imocap_core.people.shots import find_cuts

COMPARED_PX = 160  # larger side of the pictures that are compared


def cuts_of(video: Path, frames: Int[np.ndarray, " T"], size: tuple[int, int]) -> list[int]:
    """Source frames with which a new shot begins, among the used ones."""
    first, last = int(frames[0]), int(frames[-1])
    scale = min(1.0, COMPARED_PX / max(size))
    pictures = (picture for _, picture in read_gray(video, first, last + 1, scale=scale))
    return [first + cut for cut in find_cuts(pictures)]


def advice(cuts: Sequence[int], frames: Int[np.ndarray, " T"]) -> str:
    """A sentence that names the cuts and the longest shot; empty when there is no cut."""
    if not cuts:
        return ""
    edges = [int(frames[0]), *cuts, int(frames[-1]) + 1]
    longest = max(pairwise(edges), key=lambda e: e[1] - e[0])
    where = ", ".join(map(str, cuts))
    return (
        f"a new shot begins with frame{'s' if len(cuts) > 1 else ''} {where}: use one shot only, "
        f"the longest is `frames: [{longest[0]}, {longest[1]}]` in action.yaml"
    )
