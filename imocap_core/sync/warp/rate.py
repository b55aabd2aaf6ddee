"""Posterior over all warps of slowly changing rate, its prior, and playback rates of videos.

`monotone` gives every sequence of steps forward the same prior, which is right where frames were
left out at random. A performance proceeds at a rate that drifts, so here the hidden state is a
position in the other video and a rate, both on grids; from frame to frame the position advances by
the rate (split between the two grid points around it) and the rate follows its Markov chain
(`rate_prior`).

Playback rates of videos: slow motion and time lapse, from the poses. The rate of one video in
another is read from the posterior over all warps of slowly changing rate (`smooth_rate`), on few
frames and with a prior of heavy tails: half of all videos play within a third of the usual speed,
and slow motion by eight is no miracle. The rates of all pairs are differences of one number a
video, solved together by robust least squares.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from imocap_core.robust import geman_mcclure_weight
from imocap_core.sync.maps import BandedMap, frames_of, whole_band
from imocap_core.sync.procrustes import procrustes_distances
from imocap_core.sync.warp.monotone import bounded_likelihoods, moved, normalised

RATE_GRID = 0.17  # between neighbouring rates, in log units
JUMPS_PER_S = 0.2  # a rate changes to any other about this often


@dataclass(frozen=True)
class RatePrior:
    """Markov chain of K rates.

    Attributes:
        advance: positions per frame, rising.
        share: of the time a priori, summing to 1; the stationary distribution of `moves`.
        moves: P(next rate | rate), rows summing to 1.
    """

    advance: Float[np.ndarray, " K"]
    share: Float[np.ndarray, " K"]
    moves: Float[np.ndarray, "K K"]


def rate_prior(
    *, usual: float, spread: float, persistence_s: float, max_rate: float, fps: float
) -> RatePrior:
    """Rates around `usual` positions per frame, from 1 / `max_rate` to `max_rate` times it.

    Args:
        spread: standard deviation of the logarithm of a rate.
        persistence_s: time over which a rate persists.
        fps: of the video whose frames advance.

    Raises:
        ValueError: a number is out of range.
    """
    if not (usual > 0 and spread > 0 and persistence_s > 0 and max_rate >= 1 and fps > 0):
        raise ValueError(
            "usual, spread, persistence_s, fps: expected > 0 and max_rate >= 1, got "
            f"{usual}, {spread}, {persistence_s}, {fps}, {max_rate}"
        )
    reach = min(np.log(max_rate), 4.0 * spread)
    side = max(1, int(np.ceil(reach / RATE_GRID)))
    log_rate = np.arange(-side, side + 1) * (reach / side)
    share = np.exp(-0.5 * (log_rate / spread) ** 2)
    share /= share.sum()
    # a walk to the neighbours that moves log rates as fast as their spread and persistence demand
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
    return RatePrior(usual * np.exp(log_rate), share, moves)


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


COARSE_FRAMES = 120  # of each video, evenly spaced
LARGEST_RATE = 20.0  # of one video in another
USUAL_SPREAD = 0.3  # of the logarithm of a rate: scale of a Cauchy distribution
CHANGES = 1.0  # of the rate in a video, a priori
OBSERVATIONS_PER_S = 15.0
UNMATCHED = 4.0  # squared distance of a frame without counterpart, over that of matching ones
SKIPPED = 1.0  # share of a matching frame's cost: frame left over at an end
PERFORMED_RATE = 2.2  # performances of one action differ by up to this factor
ROUNDS = 10  # of iteratively reweighted least squares
SCALE = 0.3  # of the Geman-McClure weights, log units


def playback_rates(
    poses: Sequence[Float[np.ndarray, "_T J 3"]],
    weights: Sequence[Float[np.ndarray, "_T J"]],
    fps: Sequence[float],
    max_rate: float,
) -> Float[np.ndarray, " M"]:
    """Seconds of the action per second of each video, over the median video's (of two videos, over
    the faster one's): 1/8 = slow motion by 8.

    Exactly 1 for videos that differ by no more than performances do, or less than twice the
    uncertainty; at most `max_rate` either way.

    Args:
        poses: of one body scale. weights: of the joints.
    """
    log_rate, deviation = log_playback_rates(poses, weights, fps)
    limited = np.clip(log_rate, -np.log(max_rate), np.log(max_rate))
    retimed = (np.abs(limited) > np.log(PERFORMED_RATE)) & (np.abs(limited) > 2 * deviation)
    return np.where(retimed, np.exp(limited), 1.0)


_MOST_COMPARED = 8  # videos that all others are compared with, where there are many


def log_playback_rates(
    poses: Sequence[Float[np.ndarray, "_T J 3"]],
    weights: Sequence[Float[np.ndarray, "_T J"]],
    fps: Sequence[float],
) -> tuple[Float[np.ndarray, " M"], Float[np.ndarray, " M"]]:
    """Logarithms of the playback rates as estimated, and their standard deviations; of many videos
    each is compared with a few."""
    M = len(poses)
    among = range(M) if M <= 2 * _MOST_COMPARED else _thinned_to(M, _MOST_COMPARED)
    coarse = [_thinned(len(x)) for x in poses]
    log_rates, precision = np.zeros((M, M)), np.zeros((M, M))
    for i in range(M):
        for j in range(i + 1, M):
            if i not in among and j not in among:
                continue
            a, b = coarse[i], coarse[j]
            squares = procrustes_distances(poses[i][a], poses[j][b], weights[i][a], weights[j][b])
            squares = squares**2
            if not np.isfinite(squares).any():
                continue
            squares = np.where(np.isfinite(squares), squares, np.nanmean(squares))
            rates = [fps[v] * len(coarse[v]) / len(poses[v]) for v in (i, j)]
            forward = _log_rate(squares, rates[0], rates[1])
            backward = _log_rate(squares.T, rates[1], rates[0])
            log_rates[i, j] = 0.5 * (forward[0] - backward[0])
            disagreement = 0.25 * (forward[0] + backward[0]) ** 2
            precision[i, j] = 1.0 / (0.5 * (forward[1] + backward[1]) + disagreement + 1e-3)
    return _per_video(log_rates, precision)


def _thinned(frames: int) -> np.ndarray:
    """At most COARSE_FRAMES evenly spaced frames."""
    return _thinned_to(frames, COARSE_FRAMES)


def _thinned_to(count: int, most: int) -> np.ndarray:
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int))


def _log_rate(squares: np.ndarray, fps: float, fps_to: float) -> tuple[float, float]:
    """Median logarithm of the rate over the frames of the first video, and its variance."""
    N = len(squares)
    typical = max(float(np.median(squares.min(axis=1))), 1e-12)
    observations = min(OBSERVATIONS_PER_S / fps, 1.0)
    prior = heavy_tailed_prior(fps_to / fps, min(CHANGES / N, 0.5))
    share = rate_posterior(
        observations / typical * squares,
        prior,
        unmatched=observations * UNMATCHED,
        skipped=SKIPPED * observations * fps / fps_to,
    ).mean(axis=0)
    log_rate = np.log(prior.advance * fps / fps_to)
    middle = float(np.interp(0.5, np.cumsum(share) - 0.5 * share, log_rate))
    return middle, float(share @ (log_rate - middle) ** 2)


def heavy_tailed_prior(usual: float, change: float) -> RatePrior:
    """Rates around `usual` positions per frame, Cauchy in their logarithm; one persists but for
    changes of probability `change` a frame to any other."""
    side = int(np.ceil(np.log(LARGEST_RATE) / RATE_GRID))
    log_rate = np.linspace(-1, 1, 2 * side + 1) * np.log(LARGEST_RATE)
    share = 1.0 / (1.0 + (log_rate / USUAL_SPREAD) ** 2)
    share /= share.sum()
    moves = (1.0 - change) * np.eye(len(share)) + change * share
    return RatePrior(usual * np.exp(log_rate), share, moves)


def _per_video(
    log_rates: Float[np.ndarray, "M M"], precision: Float[np.ndarray, "M M"]
) -> tuple[Float[np.ndarray, " M"], Float[np.ndarray, " M"]]:
    """The numbers x of (upper) median 0 with log_rates[i, j] = x[i] - x[j] for i < j, by robust
    least squares, and their standard deviations against the other videos together."""
    M = len(log_rates)
    i, j = np.triu_indices(M, 1)
    A = np.zeros((len(i), M))
    A[np.arange(len(i)), i], A[np.arange(len(i)), j] = 1.0, -1.0
    b, weight = log_rates[i, j], precision[i, j]
    robust, x = np.ones(len(b)), np.zeros(M)
    for _ in range(ROUNDS):
        W = (robust * weight)[:, None]
        x = np.linalg.solve(A.T @ (W * A) + 1e-3 * np.eye(M), A.T @ (W[:, 0] * b))
        robust = geman_mcclure_weight(np.abs(A @ x - b), SCALE)
    information = np.abs(A).T @ (robust * weight)
    return x - np.sort(x)[M // 2], 1.0 / np.sqrt(information + 1e-9)
