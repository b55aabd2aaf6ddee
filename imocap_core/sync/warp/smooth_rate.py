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

import numpy as np
from jaxtyping import Float

from imocap_core.sync.warp.forward_backward import bounded_likelihoods, normalised
from imocap_core.sync.warp.rate_prior import RatePrior

# flat indices (K, S) of states, and the weight (K, S) of each; for the two grid points of a step
Stencil = list[tuple[np.ndarray, np.ndarray]]


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


@dataclass(frozen=True)
class _Likelihoods:
    """match (N, S) and skip (N,) of each frame; enter (K, edge): P(first matched frame lies there |
    those before are unmatched); edge: positions at either end, from the last of which a warp may
    leave."""

    match: np.ndarray
    skip: np.ndarray
    enter: np.ndarray
    edge: int

    @classmethod
    def of(cls, cost: np.ndarray, unmatched: float | np.ndarray, prior: RatePrior) -> _Likelihoods:
        match, skip, _ = bounded_likelihoods(cost, unmatched)
        edge = min(cost.shape[1], max(1, int(np.ceil(2.0 * float(prior.advance @ prior.share)))))
        enter = np.repeat(prior.share[:, None] / edge, edge, axis=1)
        return cls(match, skip, enter, edge)


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


def smooth_rate_posterior(
    cost: Float[np.ndarray, "N S"],
    prior: RatePrior,
    *,
    unmatched: float | Float[np.ndarray, " N"],
    skipped: float = 0.0,
) -> tuple[Float[np.ndarray, "N S"], Float[np.ndarray, " N"]]:
    """P(frame t lies at position s) over all warps of slowly changing rate, rows summing to 1; and
    P(matched).

    Args:
        cost, unmatched: as in `monotone_posterior`.
        skipped: cost of a position of the other video before the warp's start or after its end.
    """
    joint, outside = np.empty(cost.shape), np.empty(len(cost))
    for t, inside, no_match in _state_posteriors(cost, prior, unmatched, skipped):
        joint[t], outside[t] = inside.sum(axis=0), no_match
    return normalised(joint, outside)


def rate_posterior(
    cost: Float[np.ndarray, "N S"], prior: RatePrior, *, unmatched: float, skipped: float = 0.0
) -> Float[np.ndarray, "N K"]:
    """P(rate k at frame t | matched) over the same warps, rows summing to 1; arguments alike."""
    joint = np.empty((len(cost), len(prior.share)))
    for t, inside, _ in _state_posteriors(cost, prior, unmatched, skipped):
        joint[t] = inside.sum(axis=1)
    return normalised(joint, np.zeros(len(cost)))[0]


def _state_posteriors(
    cost: np.ndarray, prior: RatePrior, unmatched: float | np.ndarray, skipped: float
) -> Iterator[tuple[int, np.ndarray, float]]:
    """From the last frame to the first: frame, weights (K, S) of its states, and of no match.

    Forward messages are stored at some frames and recomputed between them: memory grows with
    S sqrt(N).
    """
    N, S = cost.shape
    likelihoods, transition = _Likelihoods.of(cost, unmatched, prior), _Transition.of(prior, S)
    early = np.exp(-skipped * np.arange(S))
    message = _Message(
        prior.share[:, None] * likelihoods.match[0] * early / early.sum(),
        float(likelihoods.skip[0]),
        0.0,
    ).scaled()
    stride = max(1, int(np.sqrt(N)))
    stored = {0: message}
    for t in range(1, N):
        message = _forward(message, t, likelihoods, transition).scaled()
        if t % stride == 0:
            stored[t] = message
    back = _Message(
        np.broadcast_to(early[::-1], (len(prior.share), S)), float(np.exp(-skipped * S)), 1.0
    )
    for start in reversed(range(0, N, stride)):
        stop = min(start + stride, N)
        messages = [stored[start]]
        for t in range(start + 1, stop):
            messages.append(_forward(messages[-1], t, likelihoods, transition).scaled())
        for t in range(stop - 1, start - 1, -1):
            if t < N - 1:
                back = _backward(back, t + 1, likelihoods, transition).scaled()
            here = messages[t - start]
            no_match = here.before * back.before + here.after * back.after
            yield t, here.inside * back.inside, no_match


def _forward(
    message: _Message, t: int, likelihoods: _Likelihoods, transition: _Transition
) -> _Message:
    """Message of frames 0 to t from that of frames 0 to t - 1."""
    inside = transition.forward(message.inside)
    inside[:, : likelihoods.edge] += message.before * likelihoods.enter
    after = message.after + float(message.inside[:, -likelihoods.edge :].sum())
    return _Message(
        inside * likelihoods.match[t],
        message.before * likelihoods.skip[t],
        after * likelihoods.skip[t],
    )


def _backward(
    back: _Message, t: int, likelihoods: _Likelihoods, transition: _Transition
) -> _Message:
    """Message of frames t and later to the frame before t."""
    match = back.inside * likelihoods.match[t]
    inside, skip = transition.backward(match), likelihoods.skip[t]
    inside[:, -likelihoods.edge :] += back.after * skip
    enter = float((likelihoods.enter * match[:, : likelihoods.edge]).sum())
    return _Message(inside, enter + back.before * skip, back.after * skip)
