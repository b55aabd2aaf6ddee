"""Posterior over all monotone warps: the position of each frame of a video in another one.

DTW gives the one cheapest path. With estimates as noisy as monocular ones the cheapest path follows
the noise; the mean over all paths, each weighted by its likelihood, does not. That mean is a
forward-backward pass over a hidden Markov chain whose states are positions in the other video and
whose steps are never negative. Every usual step forward is equally likely a priori, so during a
hold (a still pose) the expected positions are evenly spaced, and the spread of a frame's
distribution shows how certain its match is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.sync.pairwise.banded import Band, BandedMap, frames_of, whole_band
from imocap_core.sync.warp.forward_backward import bounded_likelihoods, moved, normalised


@dataclass(frozen=True)
class StepPrior:
    """Steps forward between neighbouring frames, in positions: every one up to `usual` is equally
    likely, every further one up to `largest` less likely by the factor `leap`.

    The probability of leaps is that of heavy tails: a video that leaves frames out, or plays a
    part many times faster, is followed; noise alone rarely pays for one.
    """

    usual: int
    largest: int
    leap: float

    def __post_init__(self) -> None:
        if not (0 < self.usual <= self.largest and 0 <= self.leap <= 1):
            raise ValueError(f"expected 0 < usual <= largest, leap in [0, 1], got {self}")

    def advanced(self, state: Float[np.ndarray, " S"]) -> Float[np.ndarray, " S"]:
        """Sum (S,) over all states that lead to each, weighted by the step."""
        total = np.add.accumulate(state)
        near = _within(total, self.usual)
        if self.leap == 0 or self.usual == self.largest:
            return near
        far = _within(total, self.largest)
        far -= near
        far *= self.leap
        far += near
        return far


def _within(total: np.ndarray, reach: int) -> np.ndarray:
    """Sum (S,) of all states at most `reach` behind, from the cumulative sum."""
    near: np.ndarray = total.copy()
    if reach + 1 < len(total):
        beyond = near[reach + 1 :]
        beyond -= total[: -reach - 1]
        np.maximum(beyond, 0.0, out=beyond)
    return near


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
    cost: BandedMap,
    *,
    unmatched: float | Float[np.ndarray, " N"],
    steps: StepPrior = ANY_STEP,
) -> tuple[BandedMap, Float[np.ndarray, " N"]]:
    """`monotone_posterior` over the warps within a band, which every frame must have."""
    N, _ = cost.shape
    inside, outside = _joint_weights(_Likelihoods.of(cost, unmatched), steps)
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
    def of(cls, cost: BandedMap, unmatched: float | np.ndarray) -> _Likelihoods:
        N, S = cost.shape
        # A match chooses among positions and "unmatched" doesn't: charge the match the prior of
        # one step of a walk that fills S positions in N frames.
        charge, skip, match = np.log1p(S / N), np.empty(N), []
        for_each = np.broadcast_to(unmatched, N)
        for rows, _, values in cost:
            likelihood, skip[rows], _ = bounded_likelihoods(values + charge, for_each[rows])
            match.append(likelihood)
        edge = max(1, int(np.ceil(2.0 * S / N)))
        return cls(cost.bands, match, skip.tolist(), edge, S)

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
    frames, skip = frames_of(likelihoods.bands), likelihoods.skip
    joint, before, after = _forward(likelihoods, steps)
    outside = np.empty(len(skip))
    here, _, _ = frames[-1]
    back, back_before, back_after = np.ones(here.stop - here.start), 1.0, 1.0
    for t in range(len(frames) - 1, -1, -1):
        here, band, row = frames[t]
        if t < len(frames) - 1:
            there, next_band, next_row = frames[t + 1]
            match = back * likelihoods.match[next_band][next_row]
            back_before = float(match[likelihoods.first(there)].sum()) + back_before * skip[t + 1]
            back_after *= skip[t + 1]
            back = moved(match, there, here, lambda x: steps.advanced(x[::-1])[::-1])
            back[likelihoods.last(here)] += back_after
            scale = max(float(back.max()), back_before, back_after)
            back /= scale
            back_before, back_after = back_before / scale, back_after / scale
        joint[band][row] *= back
        outside[t] = before[t] * back_before + after[t] * back_after
    return joint, outside


def _forward(
    likelihoods: _Likelihoods, steps: StepPrior
) -> tuple[list[np.ndarray], list[float], list[float]]:
    """Forward messages: of each frame's positions, of "before the warp's start" and of "after its
    end"."""
    frames, skip = frames_of(likelihoods.bands), likelihoods.skip
    inside = [np.empty_like(match) for match in likelihoods.match]
    before, after = [], []
    state, last, early, late = np.zeros(0), slice(0, 0), 1.0, 0.0
    for t, (here, band, row) in enumerate(frames):
        match, message = likelihoods.match[band][row], inside[band][row]
        if t:
            come = moved(state, last, here, steps.advanced)
            come[likelihoods.first(here)] += early
            np.multiply(come, match, out=message)
            late += float(state[likelihoods.last(last)].sum())
        else:
            message[:] = match
        early, late = early * skip[t], late * skip[t]
        scale = max(float(message.max()), early, late)
        message /= scale
        early, late = early / scale, late / scale
        before.append(early)
        after.append(late)
        state, last = message, here
    return inside, before, after
