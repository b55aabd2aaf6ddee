"""Advice about the cuts between the shots of a video."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Int


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
