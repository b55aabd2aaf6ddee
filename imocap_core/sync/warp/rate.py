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

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.robust import geman_mcclure_weight
from imocap_core.sync.maps import BandedMap, whole_band
from imocap_core.sync.procrustes import procrustes_distances
from imocap_core.sync.warp.monotone import frame_likelihoods, normalised, normalised_bands
from imocap_core.workers import compiled

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
    joint, _, outside = _posterior_weights(cost, prior, unmatched, skipped)
    return normalised_bands(cost, joint, outside)


def rate_posterior(
    cost: Float[np.ndarray, "N S"], prior: RatePrior, *, unmatched: float, skipped: float = 0.0
) -> Float[np.ndarray, "N K"]:
    """P(rate k at frame t | matched) over the same warps, rows summing to 1; arguments alike."""
    _, of_rates, _ = _posterior_weights(whole_band(cost), prior, unmatched, skipped)
    return normalised(of_rates, np.zeros(len(cost)))[0]


def _posterior_weights(
    cost: BandedMap, prior: RatePrior, unmatched: float | np.ndarray, skipped: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weights of the frames' positions, one frame after another, of their rates (N, K), and of no
    match (N,), each frame's up to one factor."""
    S = cost.shape[1]
    edge = min(S, max(1, int(np.ceil(2.0 * float(prior.advance @ prior.share)))))
    chain = prior.advance, prior.share, np.ascontiguousarray(prior.moves), edge
    early = np.exp(-skipped * np.arange(S + 1))
    joint, of_rates, outside = _chain_weights(frame_likelihoods(cost, unmatched), chain, early)
    return joint, of_rates, outside


@compiled
def _chain_weights(frames, chain, early):  # type: ignore[no-untyped-def]
    """`_posterior_weights` by forward and backward messages: weights of the states (rate,
    position), and two numbers, of "before the warp's start" and of "after its end".

    Forward messages are stored at some frames and computed again between them: memory grows with
    S sqrt(N).

    Args:
        frames: of `frame_likelihoods`; chain: advance, share and moves of the prior, and how many
            positions at either end a warp may begin or end at.
        early: (S + 1,) weights of a warp's first position; the last: of no position at all.
    """
    match, _, begin, width, end = frames
    N, K, S = len(width), len(chain[1]), len(early) - 1
    stride = max(1, int(np.sqrt(N)))
    rows, blocks = stride + 1, (N - 1) // stride + 1
    messages, stored = np.empty((rows, K, width.max())), np.empty((blocks, K, width.max()))
    ends, joint = np.empty((N, 2)), np.empty(len(match))
    of_rates, outside = np.empty((N, K)), np.empty(N)
    for t in range(N):
        _forward(t, messages[(t - 1) % rows], messages[t % rows], ends, frames, chain, early)
        if t % stride == 0:
            stored[t // stride] = messages[t % rows]
    back, late = np.empty((K, width[-1])), np.array([early[S], 1.0])
    back[:] = early[:S][::-1][begin[-1] : begin[-1] + width[-1]]
    for block in range(blocks - 1, -1, -1):
        first, stop = block * stride, min(block * stride + stride, N)
        messages[first % rows] = stored[block]
        for t in range(first + 1, stop):
            _forward(t, messages[(t - 1) % rows], messages[t % rows], ends, frames, chain, early)
        for t in range(stop - 1, first - 1, -1):
            if t < N - 1:
                back, late = _backward(t, back, late, frames, chain, S)
            of_frame = joint[end[t] - width[t] : end[t]]
            of_frame[:] = 0.0
            for k in range(K):
                weights = messages[t % rows, k, : width[t]] * back[k]
                of_frame += weights
                of_rates[t, k] = weights.sum()
            outside[t] = ends[t, 0] * late[0] + ends[t, 1] * late[1]
    return joint, of_rates, outside


@compiled
def _forward(t, last, message, ends, frames, chain, early):  # type: ignore[no-untyped-def]
    """Message of frames 0 to t from that of frames 0 to t - 1, in place, its largest weight 1."""
    match, skip, begin, width, end = frames
    advance, share, moves, edge = chain
    S, reached = len(early) - 1, np.zeros((len(share), width[t]))
    ends[t] = skip[t], 0.0
    if t:
        last = last[:, : width[t - 1]]
        for k in range(len(share)):
            _add_advanced(reached[k], last[k], begin[t - 1] - begin[t], advance[k])
        reached = moves.T @ reached
        first = np.arange(len(reached[0])) < edge - begin[t]
        reached += (ends[t - 1, 0] / edge) * share[:, None] * first
        left = last[:, max(0, S - edge - begin[t - 1]) :].sum()
        ends[t] = ends[t - 1, 0] * skip[t], (ends[t - 1, 1] + left) * skip[t]
    else:
        reached += share[:, None] * early[begin[0] : begin[0] + width[0]] / early[:S].sum()
    reached *= match[end[t] - width[t] : end[t]]
    largest = max(reached.max(), ends[t].max())
    message[:, : width[t]] = reached / largest
    ends[t] /= largest


@compiled
def _backward(t, back, late, frames, chain, S):  # type: ignore[no-untyped-def]
    """Message of frames t + 1 and later to frame t from that of frames t + 2 and later."""
    match, skip, begin, width, end = frames
    advance, share, moves, edge = chain
    back = back * match[end[t + 1] - width[t + 1] : end[t + 1]]
    turned, come = (moves @ back)[:, ::-1], np.zeros((len(share), width[t]))
    apart = begin[t] + width[t] - begin[t + 1] - width[t + 1]  # of the last positions
    for k in range(len(share)):
        _add_advanced(come[k, ::-1], turned[k], apart, advance[k])
    come[:, max(0, S - edge - begin[t]) :] += late[1] * skip[t + 1]
    enter = share @ back[:, : max(0, edge - begin[t + 1])].sum(axis=1) / edge
    late = np.array([enter + late[0] * skip[t + 1], late[1] * skip[t + 1]])
    largest = max(come.max(), late.max())
    return come / largest, late / largest


@compiled
def _add_advanced(target, weights, offset, advance):  # type: ignore[no-untyped-def]
    """Add the weights of positions, advanced by a step, to those of a target; what leaves it is
    lost. offset: of the first position from the target's."""
    whole = int(advance)
    for step, share in ((whole, 1.0 + whole - advance), (whole + 1, advance - whole)):
        shift = offset + step
        for place in range(max(0, -shift), min(len(weights), len(target) - shift)):
            target[place + shift] += share * weights[place]


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
    coarse = [_thinned_to(len(x), COARSE_FRAMES) for x in poses]
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


def _thinned_to(count: int, most: int) -> np.ndarray:
    """At most so many evenly spaced numbers below the count."""
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
