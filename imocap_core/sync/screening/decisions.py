"""What is decided about whole videos, by whichever evidence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Decisions:
    """Mirrored videos and videos of another action (video indices).

    Attributes:
        mirrored, outliers: detected.
        clearly_mirrored: those of `mirrored` that are clear enough to be flipped.
        undecided: look like another action, but the evidence is not clear.
        symmetric: the action is nearly its own mirror image: no video can be called mirrored.
        margin: by how much (logarithm) a video fits the others better reflected; NaN if unknown.
        score: how little the others explain a video; above `LARGEST_SCORE` is another action.
    """

    mirrored: tuple[int, ...]
    outliers: tuple[int, ...]
    margin: Float[np.ndarray, " M"]
    score: Float[np.ndarray, " M"]
    clearly_mirrored: tuple[int, ...] = ()
    undecided: tuple[int, ...] = ()
    symmetric: bool = False
