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
        total = np.cumsum(state)
        near = _within(total, self.usual)
        if self.leap == 0 or self.usual == self.largest:
            return near
        return near + self.leap * (_within(total, self.largest) - near)


def _within(total: np.ndarray, reach: int) -> np.ndarray:
    """Sum (S,) of all states at most `reach` behind, from the cumulative sum."""
    near: np.ndarray = total.copy()
    if reach + 1 < len(total):
        near[reach + 1 :] -= total[: -reach - 1]
        np.maximum(near, 0.0, out=near)
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

    entry, leave: (S,) where a warp may begin and end, near the first and the last position.
    """

    bands: Sequence[Band]
    match: Sequence[np.ndarray]
    skip: np.ndarray
    entry: np.ndarray
    leave: np.ndarray

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
        entry, leave = np.zeros(S), np.zeros(S)
        entry[:edge], leave[-edge:] = 1.0, 1.0
        return cls(cost.bands, match, skip, entry, leave)


def _joint_weights(
    likelihoods: _Likelihoods, steps: StepPrior
) -> tuple[list[np.ndarray], Float[np.ndarray, " N"]]:
    """Weights of each frame's positions, band by band, and of having no counterpart, each frame's
    up to one factor: forward messages, times backward ones."""
    frames, skip = frames_of(likelihoods.bands), likelihoods.skip
    entry, leave = likelihoods.entry, likelihoods.leave
    joint, before, after = _forward(likelihoods, steps)
    outside = np.empty(len(skip))
    here, _, _ = frames[-1]
    back, back_before, back_after = np.ones(here.stop - here.start), 1.0, 1.0
    for t in range(len(frames) - 1, -1, -1):
        here, band, row = frames[t]
        if t < len(frames) - 1:
            there, next_band, next_row = frames[t + 1]
            match = back * likelihoods.match[next_band][next_row]
            back_before = entry[there] @ match + back_before * skip[t + 1]
            back = moved(match, there, here, lambda x: steps.advanced(x[::-1])[::-1])
            back = back + leave[here] * back_after * skip[t + 1]
            back_after = back_after * skip[t + 1]
            scale = max(back.max(), back_before, back_after)
            back, back_before, back_after = back / scale, back_before / scale, back_after / scale
        joint[band][row] *= back
        outside[t] = before[t] * back_before + after[t] * back_after
    return joint, outside


def _forward(
    likelihoods: _Likelihoods, steps: StepPrior
) -> tuple[list[np.ndarray], Float[np.ndarray, " N"], Float[np.ndarray, " N"]]:
    """Forward messages: of each frame's positions, of "before the warp's start" and of "after its
    end"."""
    frames, skip = frames_of(likelihoods.bands), likelihoods.skip
    inside = [np.empty_like(match) for match in likelihoods.match]
    before, after = np.empty(len(frames)), np.zeros(len(frames))
    state, last = np.zeros(0), slice(0, 0)
    for t, (here, band, row) in enumerate(frames):
        match = likelihoods.match[band][row]
        if t:
            come = moved(state, last, here, steps.advanced)
            come = come + before[t - 1] * likelihoods.entry[here]
            after[t] = (after[t - 1] + state @ likelihoods.leave[last]) * skip[t]
            before[t] = before[t - 1] * skip[t]
            state = come * match
        else:
            before[0], state = skip[0], match
        scale = max(state.max(), before[t], after[t])
        state, before[t], after[t] = state / scale, before[t] / scale, after[t] / scale
        inside[band][row], last = state, here
    return inside, before, after
