"""Section 3.3: synchronisation and SMPL-BA in turn, until the correspondences settle."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
S = TypeVar("S")  # correspondences
M = TypeVar("M")  # motion
DIVERGED = 1.3  # cost of a round, relative to the lowest, that counts as running away
LOST_SHARE = 0.1  # a round may match this share of frames less than the best


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
    """All rounds, the index of the best, its correspondences, and a sentence.

    Where the loop settled these are the ones told by the best motion, which hardly differ from
    those that it was found with and are nearer to the truth.
    """

    turns: list[Turn[S, M]]
    best: int
    sync: S
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

    The last round is kept, unless it matches fewer frames than others do, or its cost has run
    away from the lowest.

    Args:
        first: the single pass; synchronise: new correspondences from a motion.
        recover: a new motion from correspondences and the motion before.
        maps: the per-video maps (T_v,) of correspondences; cost: of a motion.
    """
    turns = [first]
    settled: S | None = None
    status = f"stopped after {max_rounds} rounds while the correspondences still moved"
    if max_rounds == 0:
        status = "no rounds asked for: the single pass stands"
    for round_ in range(1, max_rounds + 1):
        sync = synchronise(turns[-1].motion)
        change = mean_change(maps(turns[-1].sync), maps(sync))
        if change < settled_frames:
            status = f"settled after {round_ - 1} rounds (moved {change:.2f} frames)"
            settled = sync
            break
        motion = recover(sync, turns[-1].motion)
        turns.append(Turn(sync, motion, cost(motion), change))
    best = _kept(turns, [matched_share(maps(turn.sync)) for turn in turns])
    told = settled if settled is not None and best == len(turns) - 1 else turns[best].sync
    return Alternation(turns, best, told, f"{status}; round {best} is kept")


def _kept(turns: Sequence[Turn[S, M]], shares: Sequence[float]) -> int:
    """The last round that still matches what the others match, unless its cost has run away.

    A round that loses frames looks cheap, because what it lost no longer counts.
    """
    able = [k for k, share in enumerate(shares) if share >= max(shares) - LOST_SHARE]
    best, last = min(able, key=lambda k: turns[k].cost), able[-1]
    return last if turns[last].cost <= DIVERGED * turns[best].cost else best


def matched_share(maps: Sequence[Array]) -> float:
    """Share of all frames that have a counterpart."""
    return float(np.mean(np.isfinite(np.concatenate(list(maps)))))


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
