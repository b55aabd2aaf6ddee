"""One time axis for all videos: a phase for every frame, on which all pairwise maps agree.

Each pairwise map says of a frame of video i where in video j it lies, so that its phase is that of
video j there: one linear equation in the phases of three frames. All equations of all pairs are
solved together by robust least squares (Geman-McClure weights, re-estimated), with a weak wish for
an even pace, each video's usual one, that carries the axis over frames without a counterpart.
Frames that two other videos share and the reference does not show get a phase too, before its
start or after its end.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression
from scipy.sparse import coo_array, csr_array, vstack
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from imocap_core.robust import geman_mcclure_weight

Array = NDArray[np.float64]

ROUNDS = 8
EVEN_PACE_S = 0.3  # a bend of the axis is spread over about this long
PACE_WEIGHT = 0.1  # of one equation of bend or pace, against a sure match
FIRM = 1e3  # weight of an equation that must hold
LEAST_SCALE_S = 0.02
END_FRAMES = 0.75


@dataclass(frozen=True)
class Link:
    """Where frames of video i lie in video j: positions (T_i,) fractional, NaN unknown; weights
    (T_i,) >= 0."""

    i: int
    j: int
    positions: Array
    weights: Array


def common_phase(
    fps: Sequence[float], lengths: Sequence[int], reference: int, links: Sequence[Link]
) -> list[Array]:
    """Phase (T_v,) of every frame in seconds of the reference, non-decreasing in each video.

    The reference's frames have the phase frame / fps. A video that no chain of links connects with
    the reference gets NaN.
    """
    at = np.concatenate([[0], np.cumsum(lengths)])
    known = np.zeros(at[-1], dtype=bool)
    known[at[reference] : at[reference + 1]] = True
    x = np.zeros(at[-1])
    x[known] = np.arange(lengths[reference]) / fps[reference]
    joined = _joined(len(lengths), reference, links)
    rows, weights = _equations(at, [k for k in links if joined[k.i] and joined[k.j]])
    pace, bends = _pace(at, fps, lengths, joined)
    free = np.flatnonzero(~known & np.repeat(joined, lengths))
    if len(free):
        robust = np.ones(len(weights))
        steps = [np.full(n - 1, 1.0 / f) for n, f, j in zip(lengths, fps, joined, strict=True) if j]
        wanted = np.concatenate([np.zeros(bends), *steps])
        for _ in range(ROUNDS):
            x[free] = _solved(rows, weights * robust, pace, wanted, x, known, free)
            wanted = np.concatenate([np.zeros(bends), _usual_steps(x, at, joined)])
            off = np.abs(rows @ x)
            heard = (weights > 0) & (weights < FIRM)
            scale = max(2.0 * float(np.median(off[heard])) if heard.any() else 0.0, LEAST_SCALE_S)
            robust = np.where(weights < FIRM, geman_mcclure_weight(off, scale), 1.0)
    phases = []
    for v, length in enumerate(lengths):
        own = x[at[v] : at[v + 1]]
        held = np.ones(length)
        for link in links:
            if link.i == v:
                held = np.maximum(held, np.where(link.weights >= FIRM, FIRM, 1.0))
        phases.append(isotonic_regression(own, weights=held).x if joined[v] else own * np.nan)
    return phases


def inside(positions: Array, length: int) -> NDArray[np.bool_]:
    """Positions that say where a frame lies: at the very ends of a video it may lie beyond."""
    return np.asarray((positions > END_FRAMES) & (positions < length - 1 - END_FRAMES))


def positions_in(phase: Array, other: Array) -> Array:
    """Where phases (T,) lie among another video's frames, fractional; NaN outside its range."""
    frames = np.arange(len(other), dtype=np.float64)
    if not np.isfinite(other).all():
        return np.full(len(phase), np.nan)
    rising = other + 1e-9 * frames  # frames of equal phase: any of them will do
    return np.interp(phase, rising, frames, left=np.nan, right=np.nan)


def _joined(count: int, reference: int, links: Sequence[Link]) -> NDArray[np.bool_]:
    """Which videos a chain of links connects with the reference."""
    table = np.zeros((count, count))
    for link in links:
        if (np.isfinite(link.positions) & (link.weights > 0)).any():
            table[link.i, link.j] = 1
    _, label = connected_components(csr_array(table), directed=False)
    return np.asarray(label == label[reference])


def _equations(at: NDArray[np.int64], links: Sequence[Link]) -> tuple[csr_array, Array]:
    """Rows of phase_i(t) - (1 - a) phase_j(k) - a phase_j(k + 1), and their weights."""
    entries: list[tuple[NDArray, NDArray, Array]] = []
    weights: list[Array] = []
    count = 0
    for link in links:
        length = int(at[link.j + 1] - at[link.j])
        t = np.flatnonzero(np.isfinite(link.positions) & (link.weights > 0))
        position = np.clip(link.positions[t], 0.0, length - 1.0)
        low = np.minimum(position.astype(int), max(length - 2, 0))
        high = np.minimum(low + 1, length - 1)
        share, row = position - low, count + np.arange(len(t))
        entries += [
            (row, at[link.i] + t, np.ones(len(t))),
            (row, at[link.j] + low, share - 1.0),
            (row, at[link.j] + high, -share),
        ]
        weights.append(link.weights[t])
        count += len(t)
    shape = (count, int(at[-1]))
    if not count:
        return csr_array(shape), np.zeros(0)
    row, column, value = (np.concatenate(part) for part in zip(*entries, strict=True))
    return csr_array(coo_array((value, (row, column)), shape=shape)), np.concatenate(weights)


def _pace(
    at: NDArray[np.int64],
    fps: Sequence[float],
    lengths: Sequence[int],
    joined: NDArray[np.bool_],
) -> tuple[csr_array, int]:
    """Rows of second differences (their count is returned), then of first differences, weighted so
    that a bend and a departure from the pace cost alike over EVEN_PACE_S."""
    total = int(at[-1])
    bends, steps = [csr_array((0, total))], [csr_array((0, total))]
    for v, length in enumerate(lengths):
        if not joined[v]:
            continue
        span = EVEN_PACE_S * fps[v]
        bends.append(_stencil(int(at[v]), length - 2, span**2 * np.array([1.0, -2.0, 1.0]), total))
        steps.append(_stencil(int(at[v]), length - 1, span * np.array([-1.0, 1.0]), total))
    return csr_array(vstack([*bends, *steps])), sum(b.shape[0] for b in bends)


def _stencil(first: int, count: int, values: Array, total: int) -> csr_array:
    """`count` rows that hold `values` from columns first, first + 1, ... on."""
    row = np.arange(max(count, 0))
    column = np.concatenate([first + row + k for k in range(len(values))])
    entries = (np.repeat(values, len(row)), (np.tile(row, len(values)), column))
    return csr_array(coo_array(entries, shape=(len(row), total)))


def _usual_steps(x: Array, at: NDArray[np.int64], joined: NDArray[np.bool_]) -> Array:
    """For each pair of neighbouring frames the video's median step."""
    steps = [np.diff(x[at[v] : at[v + 1]]) for v in np.flatnonzero(joined)]
    return np.concatenate([np.full(len(s), np.median(s) if len(s) else 0.0) for s in steps])


def _solved(
    rows: csr_array,
    weights: Array,
    pace: csr_array,
    wanted: Array,
    x: Array,
    known: NDArray[np.bool_],
    free: NDArray[np.int64],
) -> Array:
    """Weighted least squares for the free phases, the known ones as they are."""
    scaled = rows.multiply(np.sqrt(weights)[:, None])
    strength = PACE_WEIGHT * pace
    every = csr_array(vstack([scaled, strength]))
    # a row of first differences says: step = wanted step, both times the row's own strength
    target = np.concatenate(
        [np.zeros(rows.shape[0]), strength.max(axis=1).toarray().ravel() * wanted]
    )
    fixed = every @ np.where(known, x, 0.0) - target
    own = every[:, free]
    normal = (own.T @ own).tocsc()
    tiny = 1e-9 * float(normal.diagonal().max())
    normal.setdiag(normal.diagonal() + tiny)
    return np.asarray(splu(normal).solve(-(own.T @ fixed) + tiny * x[free]))
