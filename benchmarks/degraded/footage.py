"""Degraded footage of an action: which videos are degraded, how, and their pictures."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from jaxtyping import Float

from benchmarks.detector.degradations import (
    DEGRADATIONS,
    MIDDLE_THIRD,
    PLAIN,
    Degradation,
    Picture,
    hidden_legs,
)

Extent = Literal["none", "one", "all"]
SEED = 1
KINDS = ("legs", "blur", "second", "dropped")
ONE = 1  # the video that is degraded alone: the second
THIRDS = (MIDDLE_THIRD, 0.0, 2 / 3, 1 / 2)  # where legs are hidden in all: share of the clip
IMPOSSIBLE = (("second", "all"),)  # the mirrored performers fit each other as well


@dataclass(frozen=True)
class Footage:
    """An action's videos with none, one or all of them degraded."""

    degradation: Degradation
    extent: Extent

    @property
    def name(self) -> str:
        """A name for files."""
        return f"{self.degradation.name}-{self.extent}" if self.extent != "none" else PLAIN.name

    def degrades(self, video: int) -> bool:
        """Whether it degrades a video, by its number in the action."""
        return self.extent == "all" or (self.extent == "one" and video == ONE)

    def legs_hidden_from(self, video: int) -> float:
        """The share of the clip at which a third with hidden legs begins: in all videos another
        third in each, as nobody would see the legs there otherwise."""
        return THIRDS[video % len(THIRDS)] if self.extent == "all" else MIDDLE_THIRD


def degraded_pictures(
    pictures: Iterable[Picture], limbs: Float[np.ndarray, "T 12 2"], footage: Footage, video: int
) -> Iterator[Picture]:
    """As many pictures, so that frame numbers stay: a dropped one shows the last one again.

    Args:
        limbs: the performer's, in pixels; where some are NaN the picture stays as it is.
        video: its number in the action; other pictures of each are dropped.
    """
    degradation = footage.degradation
    change = degradation.picture
    if change is hidden_legs:
        change = partial(hidden_legs, begin=footage.legs_hidden_from(video))
    rng, shown = np.random.default_rng([SEED, video]), None
    for number, picture in enumerate(pictures):
        if shown is None or rng.random() >= degradation.dropped:
            shown = picture
        if change is not None and np.isfinite(limbs[number]).all():
            yield change(shown, limbs[number], number / len(limbs))
        else:
            yield shown


def _footages() -> Iterator[Footage]:
    yield Footage(PLAIN, "none")
    by_name = {degradation.name: degradation for degradation in DEGRADATIONS}
    extents: tuple[Extent, ...] = ("one", "all")
    for kind in KINDS:
        for extent in extents:
            if (kind, extent) not in IMPOSSIBLE:
                yield Footage(by_name[kind], extent)


FOOTAGES = tuple(_footages())  # the first is as filmed
