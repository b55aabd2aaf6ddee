"""Section 3.3: synchronisation and SMPL-BA in turn, until the correspondences settle."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
S = TypeVar("S")  # correspondences
M = TypeVar("M")  # motion
DIVERGED = 1.3


@dataclass(frozen=True)
class Turn(Generic[S, M]):
    """One round: correspondences, the motion found with them, and how good both are.

    Attributes:
        cost: of the motion, lower is better; change_frames: how far the correspondences moved.
    """

    sync: S
    motion: M
    cost: float
    change_frames: float


@dataclass(frozen=True)
class Alternation(Generic[S, M]):
    """All rounds, the index of the best, and a sentence."""

    turns: list[Turn[S, M]]
    best: int
    status: str


def alternate(
    first: Turn[S, M],
    synchronise: Callable[[M], S],
    recover: Callable[[S, M], M],
    *,
    maps: Callable[[S], Sequence[Array]],
    cost: Callable[[M], float],
    max_rounds: int,
    settled_frames: float,
) -> Alternation[S, M]:
    """Alternate until the correspondences move less than ``settled_frames`` on average.

    The last round is returned, unless its cost is more than ``DIVERGED`` times the lowest: then
    the cheapest is. Costs of rounds that match different frames are compared coarsely only.

    Args:
        first: the single pass; synchronise: new correspondences from a motion.
        recover: a new motion from correspondences and the motion before.
        maps: the per-video maps (T_v,) of correspondences; cost: of a motion.
    """
    turns = [first]
    status = f"stopped after {max_rounds} rounds while the correspondences still moved"
    if max_rounds == 0:
        status = "no rounds asked for: the single pass stands"
    for round_ in range(1, max_rounds + 1):
        sync = synchronise(turns[-1].motion)
        change = mean_change(maps(turns[-1].sync), maps(sync))
        if change < settled_frames:
            status = f"settled after {round_ - 1} rounds (moved {change:.2f} frames)"
            break
        motion = recover(sync, turns[-1].motion)
        turns.append(Turn(sync, motion, cost(motion), change))
    best, last = min(range(len(turns)), key=lambda k: turns[k].cost), len(turns) - 1
    if turns[last].cost <= DIVERGED * turns[best].cost:
        best = last
    return Alternation(turns, best, f"{status}; round {best} is kept")


def mean_change(before: Sequence[Array], after: Sequence[Array]) -> float:
    """Mean movement in reference frames of all frames that were matched both times.

    A frame that loses or gains its match counts as one frame of movement.
    """
    a, b = np.concatenate(list(before)), np.concatenate(list(after))
    both = np.isfinite(a) & np.isfinite(b)
    either = np.isfinite(a) ^ np.isfinite(b)
    if not (both | either).any():
        return 0.0
    return float((np.abs(a - b)[both].sum() + either.sum()) / (both | either).sum())
