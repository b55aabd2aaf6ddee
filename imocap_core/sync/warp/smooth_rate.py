"""All warps whose rate changes slowly: people do not sprint for a tenth of a second.

`monotone` calls every sequence of steps forward equally likely, which is right where frames were
left out at random. A performance runs at a rate of its own that drifts, so here the hidden state is
a position in the other video and a rate, both on grids; from frame to frame the position advances
by the rate (split between the two grid points around it) and the rate moves to a neighbour now and
then. Rates have limits on both sides; a rate of zero, a frozen picture or a hold, is one of them.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imocap_core.sync.warp.monotone import WORST_FRAME

Array = NDArray[np.float64]

RATE_GRID = 0.17  # between neighbouring rates, in log units
JUMPS_PER_S = 0.2  # a rate changes to any other about this often


@dataclass(frozen=True)
class Rates:
    """advance (K,) positions per frame, rising; share (K,) of the time a priori, summing to 1;
    moves (K, K), P(next rate | rate), whose long-run shares are `share`."""

    advance: Array
    share: Array
    moves: Array


def rates_between(
    *, usual: float, spread: float, persistence_s: float, max_rate: float, fps: float
) -> Rates:
    """Rates around `usual` positions per frame, from 1 / `max_rate` to `max_rate` times it, and 0.

    `spread`: standard deviation of a rate's logarithm; `persistence_s`: how long a rate lasts;
    `fps`: of the video whose frames advance.
    """
    if not (usual > 0 and spread > 0 and persistence_s > 0 and max_rate >= 1 and fps > 0):
        raise ValueError(
            "usual, spread, persistence_s, fps: expected > 0 and max_rate >= 1, got "
            f"{usual}, {spread}, {persistence_s}, {fps}, {max_rate}"
        )
    reach = min(np.log(max_rate), 4.0 * spread)
    side = max(1, int(np.ceil(reach / RATE_GRID)))
    log = np.arange(-side, side + 1) * (reach / side)
    share = np.exp(-0.5 * (log / spread) ** 2)
    share /= share.sum()
    # a walk to the neighbours that moves log rates as fast as their spread and persistence say
    drift = spread**2 / (persistence_s * fps) / max(reach / side, 1e-9) ** 2
    K = len(share)
    jump = min(JUMPS_PER_S / fps, 0.5)
    moves = np.zeros((K, K))
    for k in range(K):
        for other in (k - 1, k + 1):
            if 0 <= other < K:
                moves[k, other] = min(drift, 0.4) * min(1.0, share[other] / share[k])
    moves[np.diag_indices(K)] = 1.0 - moves.sum(axis=1)
    moves = (1.0 - jump) * moves + jump * share
    return Rates(usual * np.exp(log), share, moves)


Places = list[tuple[NDArray[np.int64], Array]]  # flat indices (K, S) and how much of each


@dataclass(frozen=True)
class _Walk:
    """From frame to frame: what comes to a place (rate, position), and what it goes to."""

    moves: Array
    sources: Places
    targets: Places

    @classmethod
    def of(cls, rates: Rates, S: int) -> "_Walk":
        return cls(rates.moves, _places(rates, S, -1), _places(rates, S, 1))

    def ahead(self, state: Array) -> Array:
        """P(position, rate) one frame later, before the frame is seen: (K, S) -> (K, S)."""
        return np.asarray(self.moves.T @ _gathered(state, self.sources))

    def behind(self, state: Array) -> Array:
        """The transpose of `ahead`."""
        return _gathered(self.moves @ state, self.targets)


def _places(rates: Rates, S: int, way: int) -> Places:
    """The two positions one frame back (`way` -1) or ahead (1) between which a rate lies."""
    K = len(rates.share)
    whole = rates.advance.astype(np.int64)
    part = rates.advance - whole
    found = []
    for step, share in ((whole, 1.0 - part), (whole + 1, part)):
        at = np.arange(S) + way * step[:, None]
        index = np.arange(K)[:, None] * S + np.clip(at, 0, S - 1)
        found.append((index, np.where((at >= 0) & (at < S), share[:, None], 0.0)))
    return found


def _gathered(state: Array, places: Places) -> Array:
    (near, its), (far, other) = places
    return np.asarray(its * state.take(near) + other * state.take(far))


@dataclass(frozen=True)
class _Likelihoods:
    match: Array  # (n, S)
    skip: Array  # (n,)
    enter: Array  # (K, edge) P(first matched frame lies in front here | those before are unmatched)
    edge: int  # positions at either end; from the last ones a warp may leave
    base: float  # log of what was taken out


def _likelihoods(cost: Array, unmatched: float, rates: Rates) -> _Likelihoods:
    S = cost.shape[1]
    base = np.minimum(cost.min(axis=1), unmatched)
    # No frame may rule a position out altogether: one bad pose would end every warp there.
    match = np.exp(np.maximum(base[:, None] - cost, -WORST_FRAME))
    skip = np.exp(np.maximum(base - unmatched, -WORST_FRAME))
    edge = min(S, max(1, int(np.ceil(2.0 * float(rates.advance @ rates.share)))))
    enter = np.repeat(rates.share[:, None] / edge, edge, axis=1)
    return _Likelihoods(match, skip, enter, edge, float(-base.sum()))


@dataclass(frozen=True)
class _Front:
    """All that the frames so far say: P(position, rate), P(before), P(after), up to one factor."""

    inside: Array
    before: float
    after: float

    def scaled(self) -> tuple["_Front", float]:
        total = max(float(self.inside.max()), self.before, self.after)
        return _Front(self.inside / total, self.before / total, self.after / total), total


def _next(front: _Front, t: int, like: _Likelihoods, walk: _Walk) -> _Front:
    inside = walk.ahead(front.inside)
    inside[:, : like.edge] += front.before * like.enter
    after = front.after + float(front.inside[:, -like.edge :].sum())
    return _Front(inside * like.match[t], front.before * like.skip[t], after * like.skip[t])


def regular_posterior(
    cost: Array, rates: Rates, *, unmatched: float, skipped: float = 0.0
) -> tuple[Array, Array, float]:
    """P(frame t lies at position s) over all warps of slowly changing rate: (n, S), rows summing to
    1; P(matched) (n,); and the log likelihood of all frames.

    `cost` (n, S) and `unmatched` as in `monotone_posterior`; `skipped`: what a position of the
    other video pays that lies before the warp's start or after its end. The forward fronts are kept
    at some frames and made again between them: memory grows with S sqrt(n).
    """
    n, S = cost.shape
    like, walk = _likelihoods(cost, unmatched, rates), _Walk.of(rates, S)
    early = np.exp(-skipped * np.arange(S))
    first = _Front(
        rates.share[:, None] * like.match[0] * early / early.sum(), float(like.skip[0]), 0.0
    )
    front, total = first.scaled()
    evidence = np.log(total) + like.base
    stride = max(1, int(np.sqrt(n)))
    kept = {0: front}
    for t in range(1, n):
        front, total = _next(front, t, like, walk).scaled()
        evidence += np.log(total)
        if t % stride == 0:
            kept[t] = front
    end = _Front(
        np.broadcast_to(early[::-1], (len(rates.share), S)), float(np.exp(-skipped * S)), 1.0
    )
    last = front.inside * end.inside
    evidence += np.log(last.sum() + front.before * end.before + front.after)

    posterior, matched = np.empty((n, S)), np.empty(n)
    back = end
    for start in reversed(range(0, n, stride)):
        stop = min(start + stride, n)
        fronts = [kept[start]]
        for t in range(start + 1, stop):
            fronts.append(_next(fronts[-1], t, like, walk).scaled()[0])
        for t in range(stop - 1, start - 1, -1):
            if t < n - 1:
                back = _before(back, t + 1, like, walk).scaled()[0]
            here = fronts[t - start]
            joint = (here.inside * back.inside).sum(axis=0)
            inside = joint.sum()
            outside = here.before * back.before + here.after * back.after
            posterior[t] = joint / inside if inside > 0 else 1.0 / S
            matched[t] = inside / (inside + outside) if inside + outside > 0 else 0.0
    return posterior, matched, float(evidence)


def _before(back: _Front, t: int, like: _Likelihoods, walk: _Walk) -> _Front:
    """What frames t and later say of the frame before t."""
    match = back.inside * like.match[t]
    inside, skip = walk.behind(match), like.skip[t]
    inside[:, -like.edge :] += back.after * skip
    enter = float((like.enter * match[:, : like.edge]).sum())
    return _Front(inside, enter + back.before * skip, back.after * skip)
