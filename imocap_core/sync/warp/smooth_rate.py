"""Posterior over all warps of slowly changing rate (forward-backward over position and rate).

`monotone` gives every sequence of steps forward the same prior, which is right where frames were
left out at random. A performance proceeds at a rate that drifts, so here the hidden state is a
position in the other video and a rate, both on grids; from frame to frame the position advances by
the rate (split between the two grid points around it) and the rate follows its Markov chain
(`rate_prior`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from imocap_core.sync.pairwise.banded import BandedMap, frames_of, whole_band
from imocap_core.sync.warp.forward_backward import bounded_likelihoods, moved, normalised
from imocap_core.sync.warp.rate_prior import RatePrior

# flat indices (K, S) of states, and the weight (K, S) of each; for the two grid points of a step
Stencil = list[tuple[np.ndarray, np.ndarray]]
TRANSITIONS = 4  # for so many numbers of positions at once


@dataclass(frozen=True)
class _Transition:
    """From frame to frame: the states that a state (rate, position) comes from and goes to."""

    moves: np.ndarray
    sources: Stencil
    targets: Stencil

    @classmethod
    def of(cls, prior: RatePrior, S: int) -> _Transition:
        return cls(prior.moves, _stencil(prior, S, -1), _stencil(prior, S, 1))

    def forward(self, state: np.ndarray) -> np.ndarray:
        """P(rate, position) (K, S) one frame later, before the frame's evidence."""
        return np.asarray(self.moves.T @ _gathered(state, self.sources))

    def backward(self, state: np.ndarray) -> np.ndarray:
        """The transpose of `forward`."""
        return _gathered(self.moves @ state, self.targets)


def _stencil(prior: RatePrior, S: int, direction: int) -> Stencil:
    """The two positions one frame back (`direction` -1) or ahead (1) around each rate's step."""
    K = len(prior.share)
    whole = prior.advance.astype(np.int64)
    part = prior.advance - whole
    stencil = []
    for step, share in ((whole, 1.0 - part), (whole + 1, part)):
        position = np.arange(S) + direction * step[:, None]
        index = np.arange(K)[:, None] * S + np.clip(position, 0, S - 1)
        inside = (position >= 0) & (position < S)
        stencil.append((index, np.where(inside, share[:, None], 0.0)))
    return stencil


def _gathered(state: np.ndarray, stencil: Stencil) -> np.ndarray:
    (near, near_weight), (far, far_weight) = stencil
    return np.asarray(near_weight * state.take(near) + far_weight * state.take(far))


class _Chain:
    """The chain over any number of positions side by side."""

    def __init__(self, prior: RatePrior) -> None:
        self._of = lru_cache(maxsize=TRANSITIONS)(lambda S: _Transition.of(prior, S))

    def forward(self, state: np.ndarray) -> np.ndarray:
        """`_Transition.forward` of as many positions as the state has."""
        return self._of(state.shape[1]).forward(state)

    def backward(self, state: np.ndarray) -> np.ndarray:
        """Its transpose."""
        return self._of(state.shape[1]).backward(state)


@dataclass(frozen=True)
class _Likelihoods:
    """match of each band, and skip (N,) of each frame; enter (K, edge): P(first matched frame lies
    there | those before are unmatched); edge: positions at either end, from the last of which a
    warp may leave; frames: positions, band, and row in it of each; S: positions."""

    match: list[np.ndarray]
    skip: np.ndarray
    enter: np.ndarray
    edge: int
    frames: list[tuple[slice, int, int]]
    S: int

    @classmethod
    def of(cls, cost: BandedMap, unmatched: float | np.ndarray, prior: RatePrior) -> _Likelihoods:
        N, S = cost.shape
        skip, match, for_each = np.empty(N), [], np.broadcast_to(unmatched, N)
        for rows, _, values in cost:
            likelihood, skip[rows], _ = bounded_likelihoods(values, for_each[rows])
            match.append(likelihood)
        edge = min(S, max(1, int(np.ceil(2.0 * float(prior.advance @ prior.share)))))
        enter = np.repeat(prior.share[:, None] / edge, edge, axis=1)
        return cls(match, skip, enter, edge, frames_of(cost.bands), S)

    def of_frame(self, t: int) -> np.ndarray:
        """Of its positions."""
        _, band, row = self.frames[t]
        return np.asarray(self.match[band][row])

    def first(self, t: int) -> tuple[slice, slice]:
        """Which of the frame's positions a warp may begin at, and where they are in `enter`."""
        here = self.frames[t][0]
        count = max(0, min(self.edge, here.stop) - here.start)
        return slice(0, count), slice(here.start, here.start + count)

    def last(self, t: int) -> slice:
        """Which of the frame's positions a warp may end at."""
        here = self.frames[t][0]
        return slice(max(0, self.S - self.edge - here.start), here.stop - here.start)


@dataclass(frozen=True)
class _Message:
    """Forward or backward message: weights of each state (K, S), of "before the warp's start" and
    of "after its end", up to one factor."""

    inside: np.ndarray
    before: float
    after: float

    def scaled(self) -> _Message:
        """The message with largest weight 1."""
        total = max(float(self.inside.max()), self.before, self.after)
        return _Message(self.inside / total, self.before / total, self.after / total)


def banded_rate_posterior(
    cost: BandedMap,
    prior: RatePrior,
    *,
    unmatched: float | Float[np.ndarray, " N"],
    skipped: float = 0.0,
) -> tuple[BandedMap, Float[np.ndarray, " N"]]:
    """P(frame t lies at position s) over all warps of slowly changing rate, rows summing to 1; and
    P(matched).

    Args:
        cost, unmatched: as in `banded_posterior`; every frame must have a band.
        skipped: cost of a position of the other video before the warp's start or after its end.
    """
    joint = cost.mapped(lambda rows, columns, values: np.empty_like(values))
    outside, frames = np.empty(cost.shape[0]), frames_of(cost.bands)
    for t, inside, no_match in _state_posteriors(cost, prior, unmatched, skipped):
        _, band, row = frames[t]
        joint.values[band][row], outside[t] = inside.sum(axis=0), no_match
    matched, values = np.empty(len(outside)), []
    for rows, _, part in joint:
        posterior, matched[rows] = normalised(part, outside[rows])
        values.append(posterior)
    return BandedMap(cost.shape, cost.bands, values), matched


def rate_posterior(
    cost: Float[np.ndarray, "N S"], prior: RatePrior, *, unmatched: float, skipped: float = 0.0
) -> Float[np.ndarray, "N K"]:
    """P(rate k at frame t | matched) over the same warps, rows summing to 1; arguments alike."""
    joint = np.empty((len(cost), len(prior.share)))
    for t, inside, _ in _state_posteriors(whole_band(cost), prior, unmatched, skipped):
        joint[t] = inside.sum(axis=1)
    return normalised(joint, np.zeros(len(cost)))[0]


def _state_posteriors(
    cost: BandedMap, prior: RatePrior, unmatched: float | np.ndarray, skipped: float
) -> Iterator[tuple[int, np.ndarray, float]]:
    """From the last frame to the first: frame, weights (K, S) of the states of its positions, and
    of no match.

    Forward messages are stored at some frames and recomputed between them: memory grows with
    S sqrt(N).
    """
    N, S = cost.shape
    likelihoods, chain = _Likelihoods.of(cost, unmatched, prior), _Chain(prior)
    early = np.exp(-skipped * np.arange(S))
    here = likelihoods.frames[0][0]
    message = _Message(
        prior.share[:, None] * likelihoods.of_frame(0) * early[here] / early.sum(),
        float(likelihoods.skip[0]),
        0.0,
    ).scaled()
    stride = max(1, int(np.sqrt(N)))
    stored = {0: message}
    for t in range(1, N):
        message = _forward(message, t, likelihoods, chain).scaled()
        if t % stride == 0:
            stored[t] = message
    late = early[::-1][likelihoods.frames[N - 1][0]]
    back = _Message(
        np.broadcast_to(late, (len(prior.share), len(late))), float(np.exp(-skipped * S)), 1.0
    )
    for start in reversed(range(0, N, stride)):
        stop = min(start + stride, N)
        messages = [stored.pop(start)]
        for t in range(start + 1, stop):
            messages.append(_forward(messages[-1], t, likelihoods, chain).scaled())
        for t in range(stop - 1, start - 1, -1):
            if t < N - 1:
                back = _backward(back, t + 1, likelihoods, chain).scaled()
            message = messages.pop()
            no_match = message.before * back.before + message.after * back.after
            yield t, message.inside * back.inside, no_match


def _forward(message: _Message, t: int, likelihoods: _Likelihoods, chain: _Chain) -> _Message:
    """Message of frames 0 to t from that of frames 0 to t - 1."""
    last, here = likelihoods.frames[t - 1][0], likelihoods.frames[t][0]
    inside = moved(message.inside, last, here, chain.forward)
    places, entries = likelihoods.first(t)
    inside[:, places] += message.before * likelihoods.enter[:, entries]
    after = message.after + float(message.inside[:, likelihoods.last(t - 1)].sum())
    return _Message(
        inside * likelihoods.of_frame(t),
        message.before * likelihoods.skip[t],
        after * likelihoods.skip[t],
    )


def _backward(back: _Message, t: int, likelihoods: _Likelihoods, chain: _Chain) -> _Message:
    """Message of frames t and later to the frame before t."""
    here, before = likelihoods.frames[t][0], likelihoods.frames[t - 1][0]
    match = back.inside * likelihoods.of_frame(t)
    inside, skip = moved(match, here, before, chain.backward), likelihoods.skip[t]
    inside[:, likelihoods.last(t - 1)] += back.after * skip
    places, entries = likelihoods.first(t)
    enter = float((likelihoods.enter[:, entries] * match[:, places]).sum())
    return _Message(inside, enter + back.before * skip, back.after * skip)
