"""Posterior over all monotone warps: the position of each frame of a video in another one.

DTW gives the one cheapest path. With estimates as noisy as monocular ones the cheapest path follows
the noise; the mean over all paths, each weighted by its likelihood, does not. That mean is a
forward-backward pass over a hidden Markov chain whose states are positions in the other video and
whose steps are never negative. Every usual step forward is equally likely a priori, so during a
hold (a still pose) the expected positions are evenly spaced, and the spread of a frame's
distribution shows how certain its match is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.sync.warp.forward_backward import bounded_likelihoods, normalised


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
    N, S = cost.shape
    # A match chooses among positions and "unmatched" doesn't: charge the match the prior of one
    # step of a walk that fills S positions in N frames.
    match_likelihood, skip_likelihood, _ = bounded_likelihoods(cost + np.log1p(S / N), unmatched)
    # a warp leaves "before" near the first position and enters "after" near the last
    edge = max(1, int(np.ceil(2.0 * S / N)))
    entry, leave = np.zeros(S), np.zeros(S)
    entry[:edge], leave[-edge:] = 1.0, 1.0

    forward, before, after = np.empty((N, S)), np.empty(N), np.zeros(N)
    forward[0], before[0] = match_likelihood[0], skip_likelihood[0]
    for t in range(N):
        if t:
            come = steps.advanced(forward[t - 1]) + before[t - 1] * entry
            forward[t] = come * match_likelihood[t]
            before[t] = before[t - 1] * skip_likelihood[t]
            after[t] = (after[t - 1] + forward[t - 1] @ leave) * skip_likelihood[t]
        scale = max(forward[t].max(), before[t], after[t])
        forward[t], before[t], after[t] = forward[t] / scale, before[t] / scale, after[t] / scale

    joint, outside = np.empty((N, S)), np.empty(N)
    back, back_before, back_after = np.ones(S), 1.0, 1.0
    for t in range(N - 1, -1, -1):
        if t < N - 1:
            match, skip = back * match_likelihood[t + 1], skip_likelihood[t + 1]
            back_before = entry @ match + back_before * skip
            back = steps.advanced(match[::-1])[::-1] + leave * back_after * skip
            back_after = back_after * skip
            scale = max(back.max(), back_before, back_after)
            back, back_before, back_after = back / scale, back_before / scale, back_after / scale
        joint[t] = forward[t] * back
        outside[t] = before[t] * back_before + after[t] * back_after
    return normalised(joint, outside)
