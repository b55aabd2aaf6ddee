"""Cuts between the shots of a video: a little of another shot at either end is left out, and for
the rest there is advice."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Int

END_S, END_SHARE = 0.5, 0.1  # of the used frames: at most so much at an end is left out


def shot_inside(cuts: Sequence[int], frames: Int[np.ndarray, " T"], fps: float) -> tuple[int, int]:
    """First and one past the last frame without what little of another shot is at either end, as
    where a clip was cut a moment too early or too late."""
    first, stop = int(frames[0]), int(frames[-1]) + 1
    most = max(1, min(round(END_S * fps), round(END_SHARE * len(frames))))
    begins = [cut for cut in cuts if cut - first <= most]
    ends = [cut for cut in cuts if stop - cut <= most]
    return max(begins, default=first), min(ends, default=stop)


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
