"""Section 3.3: synchronisation and SMPL-BA in turn, until the correspondences settle."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from jaxtyping import Float

S = TypeVar("S")  # correspondences
R = TypeVar("R")  # of a round: without what they were read from
M = TypeVar("M")  # motion
DIVERGED = 1.3  # cost of a round, relative to the lowest, that counts as running away
LOST_SHARE = 0.1  # a round may match this share of frames less than the best


@dataclass(frozen=True)
class LoopRound(Generic[S, M]):
    """One round: correspondences, the motion recovered with them, and how good both are.

    Attributes:
        cost: of the motion, lower is better.
        change_frames: mean movement of the correspondences since the round before.
    """

    sync: S
    motion: M
    cost: float
    change_frames: float


@dataclass(frozen=True)
class Alternation(Generic[S, R, M]):
    """All rounds, the index of the best, the final correspondences, and a sentence.

    Where the loop settled, the final correspondences are those estimated from the best motion; they
    hardly differ from those that it was recovered with and are nearer to the truth.
    """

    rounds: list[LoopRound[R, M]]
    best: int
    sync: S
    status: str


@dataclass(frozen=True)
class LoopSteps(Generic[S, R, M]):
    """What the loop does, and what it reads of it.

    Attributes:
        first_sync: the single pass's correspondences as a whole, which are asked for only where
            they are the result's.
        synchronise: new correspondences from a motion, the same ones whenever it is asked.
        recover: a new motion from correspondences and the motion before.
        outline: what a round keeps of its correspondences: all of them are large, and only the
            result's are needed in the end.
        maps: the per-video maps (T_v,) of an outline; cost: of a motion.
    """

    first_sync: Callable[[], S]
    synchronise: Callable[[M], S]
    recover: Callable[[S, M], M]
    outline: Callable[[S], R]
    maps: Callable[[R], Sequence[Float[np.ndarray, " _"]]]
    cost: Callable[[M], float]


def alternate(
    first: LoopRound[R, M],
    steps: LoopSteps[S, R, M],
    *,
    max_rounds: int,
    settled_frames: float,
    least_rounds: int = 0,
) -> Alternation[S, R, M]:
    """Alternate until the correspondences move less than ``settled_frames`` on average.

    The last round is the result, unless it matches fewer frames than others do, or its cost has run
    away from the lowest.

    Args:
        first: the single pass.
        least_rounds: that are gone through before the correspondences may settle.
    """
    outline, maps, cost = steps.outline, steps.maps, steps.cost
    rounds = [first]
    latest: S | None = None
    status = f"stopped after {max_rounds} rounds, before the correspondences converged"
    if max_rounds == 0:
        status = "has no rounds"
    for _ in range(max_rounds):
        latest = steps.synchronise(rounds[-1].motion)
        sync = outline(latest)
        change = mean_change(maps(rounds[-1].sync), maps(sync))
        if change < settled_frames and len(rounds) > least_rounds:
            status = f"converged: one more round moves the correspondences by {change:.2f} frames"
            break
        motion = steps.recover(latest, rounds[-1].motion)
        rounds.append(LoopRound(sync, motion, cost(motion), change))
    best = _best_round(rounds, [matched_share(maps(r.sync)) for r in rounds])
    words = f"round {best}" if best else "the first joint solve"
    if best < len(rounds) - 1:
        words += ", because later ones fit worse or match less"
        latest = steps.synchronise(rounds[best - 1].motion) if best else None
    words = f"{status}; the result is that of {words}"
    return Alternation(rounds, best, steps.first_sync() if latest is None else latest, words)


def _best_round(rounds: Sequence[LoopRound[R, M]], shares: Sequence[float]) -> int:
    """The last round that still matches what the others match, unless its cost has run away.

    A round that loses frames looks cheap, because what it lost no longer counts.
    """
    able = [k for k, share in enumerate(shares) if share >= max(shares) - LOST_SHARE]
    best, last = min(able, key=lambda k: rounds[k].cost), able[-1]
    return last if rounds[last].cost <= DIVERGED * rounds[best].cost else best


def matched_share(maps: Sequence[Float[np.ndarray, " _"]]) -> float:
    """Share of all frames that have a counterpart."""
    return float(np.mean(np.isfinite(np.concatenate(list(maps)))))


def mean_change(
    before: Sequence[Float[np.ndarray, " _"]], after: Sequence[Float[np.ndarray, " _"]]
) -> float:
    """Mean movement in reference frames of all frames that were matched both times.

    A frame that loses or gains its match counts as one frame of movement.
    """
    a, b = np.concatenate(list(before)), np.concatenate(list(after))
    both = np.isfinite(a) & np.isfinite(b)
    either = np.isfinite(a) ^ np.isfinite(b)
    if not (both | either).any():
        return 0.0
    return float((np.abs(a - b)[both].sum() + either.sum()) / (both | either).sum())
