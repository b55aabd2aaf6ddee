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

from dataclasses import astuple, dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.sync.maps import BandedMap
from imocap_core.workers import compiled

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


def normalised_bands(
    cost: BandedMap, joint: Float[np.ndarray, " _"], outside: Float[np.ndarray, " N"]
) -> tuple[BandedMap, Float[np.ndarray, " N"]]:
    """`normalised` of the weights of all frames' positions, one frame after another."""
    matched, values, used = np.empty(len(outside)), list[np.ndarray](), 0
    for rows, _, costs in cost:
        of_band = joint[used : used + costs.size].reshape(costs.shape)
        posterior, matched[rows] = normalised(of_band, outside[rows])
        values.append(posterior)
        used += costs.size
    return BandedMap(cost.shape, cost.bands, values), matched


def frame_likelihoods(
    cost: BandedMap, unmatched: float | Float[np.ndarray, " N"], charge: float = 0.0
) -> tuple[np.ndarray, ...]:
    """For compiled loops: `bounded_likelihoods` of all frames' positions, one frame after another,
    and of each frame's no match; each frame's first position, their number, and where they end.

    charge: what every match costs more.
    """
    N, match = cost.shape[0], list[np.ndarray]()
    skip, begin, width = np.empty(N), np.empty(N, int), np.empty(N, int)
    for rows, here, costs in cost:
        limit = np.broadcast_to(unmatched, N)[rows]
        likelihood, skip[rows], _ = bounded_likelihoods(costs + charge, limit)
        begin[rows], width[rows] = here.start, here.stop - here.start
        match.append(likelihood.ravel())
    return np.concatenate(match), skip, begin, width, np.cumsum(width)


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

    def mean(self, filling: float) -> float:
        """Mean step by the decaying weights; `filling` where they do not decay."""
        return self.decay / (1.0 - self.decay) if self.decay < 1.0 else filling


ANY_STEP = StepPrior(2**31, 2**31, 1.0)


def banded_posterior(
    cost: BandedMap, *, unmatched: float | Float[np.ndarray, " N"], steps: StepPrior = ANY_STEP
) -> tuple[BandedMap, Float[np.ndarray, " N"]]:
    """P(frame t lies at position s) over all monotone warps within a band, which every frame must
    have, rows summing to 1, and P(matched). The warp may start and end anywhere.

    Args:
        cost: minus the log likelihood of the match, up to a constant.
        unmatched: the same for a frame (or each) without a counterpart, allowed only before the
            first and after the last position (inf = every frame has one).
        steps: prior of the steps from frame to frame.
    """
    N, S = cost.shape
    # A match chooses among positions and "unmatched" doesn't: charge the match the prior of
    # one step of a walk at the usual rate, or of one that fills the other video where that is
    # slower. A longer video shows other content too: filling it would charge too much.
    slower, faster = sorted((steps.mean(S / N), S / N))
    edge = max(1, int(np.ceil(2.0 * faster)))  # positions at which a warp may begin, or end
    frames = frame_likelihoods(cost, unmatched, np.log1p(slower))
    return normalised_bands(cost, *_joint_weights(frames, edge, S, astuple(steps)))


@compiled
def _advance(state, start, reached, begin, steps):  # type: ignore[no-untyped-def]
    """Weights of positions from ``begin`` on: sums over all states, which lie from ``start`` on,
    that lead to each, weighted by the step."""
    usual, largest, leap, decay = steps
    low = min(start, begin)
    total, carried = np.empty(begin + len(reached) - low), 0.0
    for k in range(len(total)):
        here = low + k - start
        carried = carried * decay + (state[here] if 0 <= here < len(state) else 0.0)
        total[k] = carried
    near, far = (1.0 - leap) * decay ** (usual + 1), leap * decay ** (largest + 1)
    for k in range(len(reached)):
        place = begin - low + k
        weight = total[place]
        if place > usual:
            weight -= near * total[place - usual - 1]
        if place > largest:
            weight -= far * total[place - largest - 1]
        reached[k] = max(weight, 0.0)


@compiled
def _joint_weights(frames, edge, S, steps):  # type: ignore[no-untyped-def]
    """Weights of each frame's positions, one frame after another, and of having no counterpart,
    each frame's up to one factor: forward messages, times backward ones.

    Messages are of the frame's positions, of "before the warp's start" and "after its end".

    Args:
        frames: of `frame_likelihoods`.
        edge: of the S positions a warp may begin at so many first ones, and end at as many last.
    """
    match, skip, begin, width, end = frames
    N, joint = len(width), np.empty(len(match))
    before, after, early, late = np.empty(N), np.empty(N), 1.0, 0.0
    for t in range(N):
        message, first = joint[end[t] - width[t] : end[t]], begin[t]
        if t:
            last = joint[end[t - 1] - width[t - 1] : end[t - 1]]
            _advance(last, begin[t - 1], message, first, steps)
            message[: max(0, edge - first)] += early
            late += last[max(0, S - edge - begin[t - 1]) :].sum()
        else:
            message[:] = 1.0
        message *= match[end[t] - width[t] : end[t]]
        early, late = early * skip[t], late * skip[t]
        scale = max(message.max(), early, late)
        message /= scale
        early, late = early / scale, late / scale
        before[t], after[t] = early, late
    outside, back, early, late = np.empty(N), np.ones(width[N - 1]), 1.0, 1.0
    for t in range(N - 1, -1, -1):
        if t + 1 < N:
            back = back * match[end[t + 1] - width[t + 1] : end[t + 1]]
            early = back[: max(0, edge - begin[t + 1])].sum() + early * skip[t + 1]
            late *= skip[t + 1]
            come, stop = np.empty(width[t]), S - begin[t] - width[t]
            later = S - begin[t + 1] - width[t + 1]
            _advance(back[::-1], later, come[::-1], stop, steps)
            come[max(0, S - edge - begin[t]) :] += late
            scale = max(come.max(), early, late)
            back = come / scale
            early, late = early / scale, late / scale
        joint[end[t] - width[t] : end[t]] *= back
        outside[t] = before[t] * early + after[t] * late
    return joint, outside
