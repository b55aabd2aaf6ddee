"""Posterior over all monotone warps: the position of each frame of a video in another one.

DTW gives the one cheapest path. With estimates as noisy as monocular ones it follows the noise; the
mean over all paths, each weighted by its likelihood, does not. That mean is a forward-backward pass
over a hidden Markov chain whose states are positions in the other video and whose steps are never
negative and geometrically distributed about the usual rate. Between two clear matches every way to
divide the positions is then equally likely, so during a hold (a still pose) the expected positions
are evenly spaced; before the first and after the last clear match the warp goes on at the usual
rate. The spread of a frame's distribution shows how certain its match is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from imocap_core.sync.maps import Band, BandedMap, whole_band

# a frame's worst position is at most this much less likely than its best one, in nats
WORST_FRAME = 25.0


def bounded_likelihoods(
    cost: Float[np.ndarray, "N S"], unmatched: float | Float[np.ndarray, " N"]
) -> tuple[Float[np.ndarray, "N S"], Float[np.ndarray, " N"], Float[np.ndarray, " N"]]:
    """Likelihoods of the match and of no match, and the cost (N,) that is divided out of both.

    No frame may rule a position out altogether: one bad pose would end every warp there.
    """
    base = np.minimum(cost.min(axis=1), unmatched)
    match = np.exp(np.maximum(base[:, None] - cost, -WORST_FRAME))
    skip = np.exp(np.maximum(base - unmatched, -WORST_FRAME))
    return match, skip, base


def normalised(
    joint: Float[np.ndarray, "N S"], outside: Float[np.ndarray, " N"]
) -> tuple[Float[np.ndarray, "N S"], Float[np.ndarray, " N"]]:
    """P(position | matched) and P(matched) of each frame, from the joint weights of its positions
    and of having no counterpart."""
    inside = joint.sum(axis=1)
    total = inside + outside
    posterior = joint / np.where(inside > 0, inside, 1.0)[:, None]
    posterior[~(inside > 0)] = 1.0 / joint.shape[1]
    matched = np.divide(inside, total, out=np.zeros(len(inside)), where=total > 0)
    return posterior, matched


def moved(
    state: np.ndarray, here: slice, there: slice, step: Callable[[np.ndarray], np.ndarray]
) -> np.ndarray:
    """A step of the chain from the positions `here` (..., S_here) to the positions `there`, of
    which those that the state does not have are 0."""
    if here == there:
        return step(state)
    first, stop = min(here.start, there.start), max(here.stop, there.stop)
    wide = np.zeros((*state.shape[:-1], stop - first))
    wide[..., here.start - first : here.stop - first] = state
    return step(wide)[..., there.start - first : there.stop - first]


@dataclass(frozen=True)
class StepPrior:
    """Steps forward between neighbouring frames, in positions: one of k has weight decay^k up to
    `usual`, and less by the factor `leap` up to `largest`.

    The probability of leaps is that of heavy tails: a video that leaves frames out, or plays a
    part many times faster, is followed; noise alone rarely pays for one.
    """

    usual: int
    largest: int
    leap: float
    decay: float = 1.0

    def __post_init__(self) -> None:
        if not (0 < self.usual <= self.largest and 0 <= self.leap <= 1 and 0 < self.decay <= 1):
            raise ValueError(f"expected 0 < usual <= largest, leap and decay in [0, 1], got {self}")

    def advanced(self, state: Float[np.ndarray, " S"]) -> Float[np.ndarray, " S"]:
        """Sum (S,) over all states that lead to each, weighted by the step."""
        total = self._decaying_sum(state)
        beyond_usual = total[: -self.usual - 1]
        if not len(beyond_usual):
            return total
        weighted = total.copy()
        weighted[self.usual + 1 :] -= (
            (1.0 - self.leap) * self.decay ** (self.usual + 1) * beyond_usual
        )
        beyond_largest = total[: -self.largest - 1]
        if len(beyond_largest):
            weighted[self.largest + 1 :] -= (
                self.leap * self.decay ** (self.largest + 1) * beyond_largest
            )
        if len(beyond_largest) or self.leap == 0:  # else what is left is at least a leap's share
            np.maximum(weighted, 0.0, out=weighted)
        return weighted

    def mean(self, filling: float) -> float:
        """Mean step by the decaying weights; `filling` where they do not decay."""
        return self.decay / (1.0 - self.decay) if self.decay < 1.0 else filling

    def _decaying_sum(self, state: Float[np.ndarray, " S"]) -> Float[np.ndarray, " S"]:
        """Sum (S,) over all states at or before each, weighted by decay^distance."""
        if self.decay == 1.0:
            return np.add.accumulate(state)
        powers, inverses = self._powers
        total, carried = np.empty_like(state), 0.0
        for first in range(0, len(state), len(powers)):
            block = total[first : first + len(powers)]
            weighted = state[first : first + len(powers)] * inverses[: len(block)]
            np.add.accumulate(weighted, out=block)
            block += self.decay * carried
            block *= powers[: len(block)]
            carried = block[-1]
        return total

    @cached_property
    def _powers(self) -> tuple[np.ndarray, np.ndarray]:
        """decay^0, decay^1, ..., as many as are far from underflow, and one by each."""
        most = min(1 + int(np.log(1e-200) / np.log(self.decay)), MOST_POWERS)
        powers = self.decay ** np.arange(most)
        return powers, 1.0 / powers

    def led_to(self, state: Float[np.ndarray, " S"]) -> Float[np.ndarray, " S"]:
        """Sum (S,) over all states that each leads to, weighted by the step."""
        return self.advanced(state[::-1])[::-1]


MOST_POWERS = 50_000
ANY_STEP = StepPrior(2**31, 2**31, 1.0)


def monotone_posterior(
    cost: Float[np.ndarray, "N S"],
    *,
    unmatched: float | Float[np.ndarray, " N"],
    steps: StepPrior = ANY_STEP,
) -> tuple[Float[np.ndarray, "N S"], Float[np.ndarray, " N"]]:
    """P(frame t lies at position s) over all monotone warps, rows summing to 1, and P(matched).

    The warp may start and end anywhere.

    Args:
        cost: minus the log likelihood of the match, up to a constant.
        unmatched: the same for a frame (or each) without a counterpart, allowed only before the
            first and after the last position (inf = every frame has one).
        steps: prior of the steps from frame to frame.
    """
    posterior, matched = banded_posterior(whole_band(cost), unmatched=unmatched, steps=steps)
    return posterior.values[0], matched


def banded_posterior(
    cost: BandedMap, *, unmatched: float | Float[np.ndarray, " N"], steps: StepPrior = ANY_STEP
) -> tuple[BandedMap, Float[np.ndarray, " N"]]:
    """`monotone_posterior` over the warps within a band, which every frame must have."""
    N, _ = cost.shape
    inside, outside = _joint_weights(_Likelihoods.of(cost, unmatched, steps), steps)
    matched, values = np.empty(N), []
    for (rows, _), joint in zip(cost.bands, inside, strict=True):
        posterior, matched[rows] = normalised(joint, outside[rows])
        values.append(posterior)
    return BandedMap(cost.shape, cost.bands, values), matched


@dataclass(frozen=True)
class _Likelihoods:
    """Of the match at each position of the frame's band, and of no match.

    skip: (N,). edge: of the S positions a warp may begin at so many first ones, and end at as many
    last ones.
    """

    bands: Sequence[Band]
    match: Sequence[np.ndarray]
    skip: list[float]
    edge: int
    S: int

    @classmethod
    def of(cls, cost: BandedMap, unmatched: float | np.ndarray, steps: StepPrior) -> _Likelihoods:
        N, S = cost.shape
        # A match chooses among positions and "unmatched" doesn't: charge the match the prior of
        # one step of a walk at the usual rate, or of one that fills the other video where that is
        # slower. A longer video shows other content too: filling it would charge too much.
        slower, faster = sorted((steps.mean(S / N), S / N))
        charge, skip, match = np.log1p(slower), np.empty(N), []
        for_each = np.broadcast_to(unmatched, N)
        for rows, _, values in cost:
            likelihood, skip[rows], _ = bounded_likelihoods(values + charge, for_each[rows])
            match.append(likelihood)
        return cls(cost.bands, match, skip.tolist(), max(1, int(np.ceil(2.0 * faster))), S)

    def first(self, here: slice) -> slice:
        """Where a warp may begin, of these positions."""
        return slice(0, max(0, self.edge - here.start))

    def last(self, here: slice) -> slice:
        """Where a warp may end, of these positions."""
        return slice(max(0, self.S - self.edge - here.start), None)


def _joint_weights(
    likelihoods: _Likelihoods, steps: StepPrior
) -> tuple[list[np.ndarray], Float[np.ndarray, " N"]]:
    """Weights of each frame's positions, band by band, and of having no counterpart, each frame's
    up to one factor: forward messages, times backward ones."""
    joint, before, after = _forward(likelihoods, steps)
    outside = np.empty(len(likelihoods.skip))
    back, back_before, back_after = np.ones(0), 1.0, 1.0
    likelihood, skip, there, first = np.ones(0), 1.0, slice(0, 0), slice(0, 0)  # of the next frame
    for (rows, here), match, messages in reversed(
        list(zip(likelihoods.bands, likelihoods.match, joint, strict=True))
    ):
        last, starts = likelihoods.last(here), likelihoods.first(here)
        for row in range(len(messages) - 1, -1, -1):
            t = rows.start + row
            if t + 1 < len(outside):
                back = back * likelihood
                back_before = _sum(back, first) + back_before * skip
                back_after *= skip
                back = moved(back, there, here, steps.led_to)
                if last.start < len(back):
                    back[last] += back_after
                scale = max(float(np.maximum.reduce(back)), back_before, back_after)
                back /= scale
                back_before, back_after = back_before / scale, back_after / scale
            else:
                back = np.ones(here.stop - here.start)
            messages[row] *= back
            outside[t] = before[t] * back_before + after[t] * back_after
            likelihood, skip = match[row], likelihoods.skip[t]
            there, first = here, starts
    return joint, outside


def _forward(
    likelihoods: _Likelihoods, steps: StepPrior
) -> tuple[list[np.ndarray], list[float], list[float]]:
    """Forward messages: of each frame's positions, of "before the warp's start" and of "after its
    end"."""
    inside = [np.empty_like(match) for match in likelihoods.match]
    before, after = list[float](), list[float]()
    state, there, last, early, late = np.zeros(0), slice(0, 0), slice(0, 0), 1.0, 0.0
    for (rows, here), match, messages in zip(
        likelihoods.bands, likelihoods.match, inside, strict=True
    ):
        first, ends = likelihoods.first(here), likelihoods.last(here)
        for likelihood, message, skip in zip(match, messages, likelihoods.skip[rows], strict=True):
            if before:
                come = moved(state, there, here, steps.advanced)
                if first.stop:
                    come[first] += early
                np.multiply(come, likelihood, out=message)
                late += _sum(state, last)
            else:
                message[:] = likelihood
            early, late = early * skip, late * skip
            scale = max(float(np.maximum.reduce(message)), early, late)
            message /= scale
            early, late = early / scale, late / scale
            before.append(early)
            after.append(late)
            state, there, last = message, here, ends
    return inside, before, after


def _sum(weights: np.ndarray, where: slice) -> float:
    """Of the weights there; most frames of long videos are not near an end and have none."""
    if where.start >= min(where.stop or len(weights), len(weights)):
        return 0.0
    return float(np.add.reduce(weights[where]))
