"""Common time axis: a phase for every frame, from all pairwise maps; consistency and pace.

Each pairwise map gives a frame of video i a position in video j, whose phase must be the same: one
linear equation in the phases of three frames. All are solved together by robust least squares
(Geman-McClure weights, re-estimated), with a weak prior for an even pace, each video's usual one,
that carries the axis over frames without a counterpart. Frames that two other videos share and the
reference does not show get a phase too, before its start or after its end.

Consistency, without truth: maps are computed pair by pair. Where a cycle of three videos ends where
it began, they are likely right; where a direct map to the reference differs from those through
other videos, one of them is wrong. Pace: a video that stalls and jumps (freeze frames, edited slow
motion, wrong poses) is a poor time axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import isotonic_regression, nnls
from scipy.sparse import coo_array, csr_array, vstack
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from imocap_core.robust import geman_mcclure_weight
from imocap_core.sync.maps import BandedMap
from imocap_core.sync.warp.soft_maps import Clocks
from imocap_core.sync.warp.template import mass_within, median_positions


@dataclass(frozen=True)
class PairMaps:
    """Maps from every video to every other one, pair by pair; of many videos not of all pairs.

    Attributes:
        positions: [i, j]: fractional frames of j for the frames of i, NaN unmatched.
        confidence: [i, j]: in [0, 1].
    """

    positions: dict[tuple[int, int], Float[np.ndarray, "_T"]]
    confidence: dict[tuple[int, int], Float[np.ndarray, "_T"]]

    def through(self, v: int, target: int) -> list[Float[np.ndarray, "_T"]]:
        """Positions of a video's frames in another, through every third one that both have maps
        with."""
        others = sorted({i for i, _ in self.positions} - {v, target})
        return [
            composed(self.positions[v, u], self.positions[u, target])
            for u in others
            if (v, u) in self.positions and (u, target) in self.positions
        ]


@dataclass(frozen=True)
class CycleResidual:
    """Mean distance between a frame and its image after a cycle of three videos.

    Attributes:
        frames, seconds: the distance, of the first video; NaN where no frame comes back.
        share: of the frames that come back.
    """

    videos: tuple[int, int, int]
    frames: float
    seconds: float
    share: float


def map_of_pair(
    soft_map: BandedMap, matched: Float[np.ndarray, " N"], reach_frames: float
) -> tuple[Float[np.ndarray, " N"], Float[np.ndarray, " N"]]:
    """Median positions of a soft map between whole frames, where P(matched) is at least 1/2, and
    confidences."""
    position = median_positions(soft_map)
    mass = mass_within(soft_map, position, reach_frames) * matched
    return (
        np.where(matched >= 0.5, position, np.nan),
        np.where(matched >= 0.5, np.minimum(mass, 1.0), 0.0),
    )


def composed(
    positions: Float[np.ndarray, " T"], then: Float[np.ndarray, " S"]
) -> Float[np.ndarray, " T"]:
    """Composition of two maps: `positions` of the first in the second's frames, where the second
    maps whole frames by `then`; NaN where either is unmatched."""
    S = len(then)
    low = np.clip(np.floor(np.nan_to_num(positions)).astype(int), 0, max(S - 2, 0))
    high = np.minimum(low + 1, S - 1)
    share = np.clip(positions - low, 0.0, 1.0)
    between = (1 - share) * then[low] + share * then[high]
    out: np.ndarray = np.where(share == 0, then[low], np.where(share == 1, then[high], between))
    return np.where(np.isfinite(positions), out, np.nan)


def cycle_residuals(
    pairs: PairMaps, lengths: Sequence[int], fps: Sequence[float]
) -> list[CycleResidual]:
    """All triples of videos a < b < c with maps among them, each cycle in both directions."""
    residuals = []
    for a, b, c in combinations(range(len(lengths)), 3):
        if not all(pair in pairs.positions for pair in ((a, b), (a, c), (b, c))):
            continue
        distances, count = [], 0
        for second, third in ((b, c), (c, b)):
            there = composed(pairs.positions[a, second], pairs.positions[second, third])
            back = composed(there, pairs.positions[third, a])
            distances.append(np.abs(back - np.arange(lengths[a])))
            count += lengths[a]
        every = np.concatenate(distances)
        every = every[np.isfinite(every)]
        frames = float(every.mean()) if len(every) else float("nan")
        share = len(every) / max(count, 1)
        residuals.append(CycleResidual((a, b, c), frames, frames / fps[a], share))
    return residuals


def left_out_disagreement(
    pairs: PairMaps, lengths: Sequence[int], reference: int
) -> tuple[Float[np.ndarray, " M"], Float[np.ndarray, " M"]]:
    """Distance of each video's direct map to the reference from the maps through the others.

    Returns:
        Mean over frames of |direct - median over the other videos|, in frames of the reference; and
        the share of frames that both match. NaN for the reference and where no other video leads
        there.
    """
    M = len(lengths)
    frames, share = np.full(M, np.nan), np.full(M, np.nan)
    for v in range(M):
        through_others = [] if v == reference else pairs.through(v, reference)
        if not through_others:
            continue
        direct, indirect = pairs.positions[v, reference], np.stack(through_others)
        some = np.isfinite(indirect).any(axis=0)
        through = np.full(lengths[v], np.nan)
        through[some] = np.nanmedian(indirect[:, some], axis=0)
        distance = np.abs(direct - through)
        both = np.isfinite(distance)
        share[v] = float(both.mean())
        if both.any():
            frames[v] = float(distance[both].mean())
    return frames, share


ROUNDS = 8  # of iteratively reweighted least squares
EVEN_PACE_S = 0.3  # a bend of the axis is spread over about this long
PACE_WEIGHT = 0.1  # of one equation of bend or pace, against a certain match
HARD_WEIGHT = 1e3  # weight of an equation that must hold
LEAST_SCALE_S = 0.02  # of the Geman-McClure weights
END_FRAMES = 0.75  # positions nearer to an end of a video may lie beyond it


@dataclass(frozen=True)
class WeightedMap:
    """Positions of the frames of video i in video j, fractional, NaN unknown; weights >= 0."""

    i: int
    j: int
    positions: Float[np.ndarray, " T"]
    weights: Float[np.ndarray, " T"]


def common_phase(
    fps: Sequence[float], lengths: Sequence[int], reference: int, maps: Sequence[WeightedMap]
) -> list[Float[np.ndarray, "_T"]]:
    """Phase of every frame of each video in seconds of the reference, non-decreasing.

    The reference's frames have the phase frame / fps. A video that no chain of maps connects with
    the reference gets NaN.
    """
    offsets = np.concatenate([[0], np.cumsum(lengths)])
    fixed = np.zeros(offsets[-1], dtype=bool)
    fixed[offsets[reference] : offsets[reference + 1]] = True
    x = np.zeros(offsets[-1])
    x[fixed] = np.arange(lengths[reference]) / fps[reference]
    connected = _connected(len(lengths), reference, maps)
    rows, weights = _equations(offsets, [k for k in maps if connected[k.i] and connected[k.j]])
    pace, bends = _pace(offsets, fps, lengths, connected)
    free = np.flatnonzero(~fixed & np.repeat(connected, lengths))
    if len(free):
        robust = np.ones(len(weights))
        steps = [
            np.full(n - 1, 1.0 / f) for n, f, c in zip(lengths, fps, connected, strict=True) if c
        ]
        expected = np.concatenate([np.zeros(bends), *steps])
        for _ in range(ROUNDS):
            x[free] = _solved(rows, weights * robust, pace, expected, x, fixed, free)
            expected = np.concatenate([np.zeros(bends), _usual_steps(x, offsets, connected)])
            residual = np.abs(rows @ x)
            soft = (weights > 0) & (weights < HARD_WEIGHT)
            median = float(np.median(residual[soft])) if soft.any() else 0.0
            scale = max(2.0 * median, LEAST_SCALE_S)
            robust = np.where(weights < HARD_WEIGHT, geman_mcclure_weight(residual, scale), 1.0)
    phases = []
    for v, length in enumerate(lengths):
        phase = x[offsets[v] : offsets[v + 1]]
        weight = np.ones(length)
        for k in maps:
            if k.i == v:
                weight = np.maximum(weight, np.where(k.weights >= HARD_WEIGHT, HARD_WEIGHT, 1.0))
        phases.append(
            isotonic_regression(phase, weights=weight).x if connected[v] else phase * np.nan
        )
    return phases


def inside(positions: Float[np.ndarray, " T"], length: int) -> Bool[np.ndarray, " T"]:
    """Positions away from the ends of a video: a frame matched to an end may lie beyond it."""
    return np.asarray((positions > END_FRAMES) & (positions < length - 1 - END_FRAMES))


def _connected(count: int, reference: int, maps: Sequence[WeightedMap]) -> np.ndarray:
    """Which videos (M,) a chain of maps connects with the reference."""
    table = np.zeros((count, count))
    for k in maps:
        if (np.isfinite(k.positions) & (k.weights > 0)).any():
            table[k.i, k.j] = 1
    _, label = connected_components(csr_array(table), directed=False)
    return np.asarray(label == label[reference])


def _equations(offsets: np.ndarray, maps: Sequence[WeightedMap]) -> tuple[csr_array, np.ndarray]:
    """Rows of phase_i(t) - (1 - a) phase_j(k) - a phase_j(k + 1), and their weights."""
    entries: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    weights: list[np.ndarray] = []
    count = 0
    for m in maps:
        length = int(offsets[m.j + 1] - offsets[m.j])
        t = np.flatnonzero(np.isfinite(m.positions) & (m.weights > 0))
        position = np.clip(m.positions[t], 0.0, length - 1.0)
        low = np.minimum(position.astype(int), max(length - 2, 0))
        high = np.minimum(low + 1, length - 1)
        share, row = position - low, count + np.arange(len(t))
        entries += [
            (row, offsets[m.i] + t, np.ones(len(t))),
            (row, offsets[m.j] + low, share - 1.0),
            (row, offsets[m.j] + high, -share),
        ]
        weights.append(m.weights[t])
        count += len(t)
    shape = (count, int(offsets[-1]))
    if not count:
        return csr_array(shape), np.zeros(0)
    row, column, value = (np.concatenate(part) for part in zip(*entries, strict=True))
    return csr_array(coo_array((value, (row, column)), shape=shape)), np.concatenate(weights)


def _pace(
    offsets: np.ndarray, fps: Sequence[float], lengths: Sequence[int], connected: np.ndarray
) -> tuple[csr_array, int]:
    """Rows of second differences (their count is returned), then of first differences, weighted so
    that a bend and a departure from the pace cost alike over EVEN_PACE_S."""
    total = int(offsets[-1])
    bends, steps = [csr_array((0, total))], [csr_array((0, total))]
    for v, length in enumerate(lengths):
        if not connected[v]:
            continue
        first, span = int(offsets[v]), EVEN_PACE_S * fps[v]
        bends.append(_stencil(first, length - 2, span**2 * np.array([1.0, -2.0, 1.0]), total))
        steps.append(_stencil(first, length - 1, span * np.array([-1.0, 1.0]), total))
    return csr_array(vstack([*bends, *steps])), sum(b.shape[0] for b in bends)


def _stencil(first: int, count: int, values: np.ndarray, total: int) -> csr_array:
    """`count` rows with `values` in columns first, first + 1, ..., shifted by one each row."""
    row = np.arange(max(count, 0))
    column = np.concatenate([first + row + k for k in range(len(values))])
    entries = (np.repeat(values, len(row)), (np.tile(row, len(values)), column))
    return csr_array(coo_array(entries, shape=(len(row), total)))


def _usual_steps(x: np.ndarray, offsets: np.ndarray, connected: np.ndarray) -> np.ndarray:
    """For each pair of neighbouring frames the video's median step."""
    steps = [np.diff(x[offsets[v] : offsets[v + 1]]) for v in np.flatnonzero(connected)]
    return np.concatenate([np.full(len(s), np.median(s) if len(s) else 0.0) for s in steps])


def _solved(
    rows: csr_array,
    weights: np.ndarray,
    pace: csr_array,
    expected: np.ndarray,
    x: np.ndarray,
    fixed: np.ndarray,
    free: np.ndarray,
) -> np.ndarray:
    """Weighted least squares for the free phases, the fixed ones as they are."""
    scaled = rows.multiply(np.sqrt(weights)[:, None])
    strength = PACE_WEIGHT * pace
    every = csr_array(vstack([scaled, strength]))
    # a row of first differences means: step = expected step, both times the row's strength
    target = np.concatenate(
        [np.zeros(rows.shape[0]), strength.max(axis=1).toarray().ravel() * expected]
    )
    constant = every @ np.where(fixed, x, 0.0) - target
    columns = every[:, free]
    normal = (columns.T @ columns).tocsc()
    tiny = 1e-9 * float(normal.diagonal().max())
    normal.setdiag(normal.diagonal() + tiny)
    return np.asarray(splu(normal).solve(-(columns.T @ constant) + tiny * x[free]))


WINDOW_S = 0.3  # of the action: over which a pace is measured
_SLOWEST = 3.0  # pace of one video in another; performances of one action differ by less


def shown_motion(
    pairs: PairMaps, moving: Sequence[Float[np.ndarray, "_T"]], clocks: Clocks
) -> Float[np.ndarray, " M"]:
    """Share of the other videos' motion that goes on in each video as well, mean over videos.

    Repetitions that a video lacks are matched to moments where it stands still or creeps.

    Args:
        moving: weight of each frame by how much its pose changes.
    """
    M, fps = len(moving), clocks.action_fps
    share = np.zeros((M, M))
    for i, j in pairs.positions:
        pace = _pace_in(pairs, (i, j), len(moving[j]), fps[i])
        middle = moving[i][(len(moving[i]) - len(pace)) // 2 :][: len(pace)]
        goes_on = pace > fps[j] / fps[i] / _SLOWEST
        share[i, j] = float(middle @ goes_on) / max(float(middle.sum()), 1e-9)
    return np.asarray(share.sum(axis=0) / max(M - 1, 1))


def _pace_in(
    pairs: PairMaps, pair: tuple[int, int], length: int, fps: float
) -> Float[np.ndarray, " _P"]:
    """Frames of the second video per frame of the first, over windows of `WINDOW_S`; NaN where it
    does not show them, or at its ends."""
    position, steps = pairs.positions[pair], max(1, round(WINDOW_S * fps))
    shown = np.where(inside(np.nan_to_num(position), length), position, np.nan)
    return np.asarray((shown[steps:] - shown[:-steps]) / steps)


def pace_spread(pairs: PairMaps, lengths: Sequence[int], clocks: Clocks) -> Float[np.ndarray, " M"]:
    """Standard deviation (M,) of each video's pace about its usual one, which is 1.

    The pace of one video in another varies by the variances of both; all pairs tell them apart. Of
    two videos neither is known to be the one that varies: both have half.
    """
    M = len(lengths)
    videos = [pair for pair in combinations(range(M), 2) if pair in pairs.positions]
    shared = np.array([_pace_variance(pairs, pair, lengths, clocks) for pair in videos])
    measured = np.isfinite(shared)
    if not measured.any():
        return np.zeros(M)
    equations = np.array([[float(v in pair) for v in range(M)] for pair in videos])
    if M == 2:
        return np.sqrt(np.full(2, shared[0] / 2))
    return np.sqrt(nnls(equations[measured], shared[measured])[0])


def _pace_variance(
    pairs: PairMaps, pair: tuple[int, int], lengths: Sequence[int], clocks: Clocks
) -> float:
    """Of the pace of two videos in each other, relative to its mean; NaN where they share too
    little."""
    variances = []
    for i, j in (pair, pair[::-1]):
        pace = _pace_in(pairs, (i, j), lengths[j], clocks.action_fps[i])
        several = len(pairs.positions[i, j]) - len(pace)
        pace = pace[np.isfinite(pace)]
        if len(pace) > several and pace.mean() > 0:
            variances.append(float(np.var(pace / pace.mean())))
    return float(np.mean(variances)) if variances else np.nan
