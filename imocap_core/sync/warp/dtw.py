"""Dynamic time warping with open ends (Sakoe and Chiba 1978; the paper's last step of
synchronisation).

A path runs monotonically through the cost matrix. Every frame of either video pays once: the cost
of the cell it is matched in, or `skip` when it lies before the path's start or after its end. A
diagonal step therefore weighs two (a frame of each video), a straight step one; swapping the
videos transposes the path. An infinite `skip` closes the ends.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Path = NDArray[np.int64]

_START, _DIAGONAL, _DOWN, _RIGHT = 0, 1, 2, 3


def _skewed(cost: Array) -> Array:
    """Anti-diagonals as rows: out[i + j, i] = cost[i, j]; infinite elsewhere."""
    n, m = cost.shape
    out = np.full((n, n + m), np.inf)
    for i in range(n):
        out[i, i : i + m] = cost[i]
    return np.ascontiguousarray(out.T[: n + m - 1])


def _accumulate(cost: Array, skip: float) -> tuple[Array, NDArray[np.uint8]]:
    """Skewed accumulated cost and, for each cell, the step it was reached by; one anti-diagonal at
    a time."""
    n, m = cost.shape
    skew = _skewed(cost)
    step = np.zeros(skew.shape, dtype=np.uint8)
    total = np.full((n + m - 1, n), np.inf)
    start = np.full(
        (n + m - 1, n), np.inf
    )  # cost of the frames skipped before a path starting here
    start[0, 0] = 0.0
    if np.isfinite(skip):
        start[np.arange(m), 0] = skip * np.arange(m)
        start[np.arange(n), np.arange(n)] = skip * np.arange(n)
    total[0] = start[0] + 2.0 * skew[0]
    nothing = np.array([np.inf])
    before = np.full(n, np.inf)
    for d in range(1, n + m - 1):
        c = skew[d]
        diagonal = np.concatenate([nothing, before[:-1]]) + 2.0 * c
        down = np.concatenate([nothing, total[d - 1, :-1]]) + c
        right = total[d - 1] + c
        options = np.stack([start[d] + 2.0 * c, diagonal, down, right])
        step[d] = options.argmin(axis=0)
        total[d] = options.min(axis=0)
        before = total[d - 1]
    return total, step


def dtw(cost: Array, *, skip: float = np.inf) -> tuple[Path, float]:
    """The cheapest monotone path through a cost matrix (n, m), as index pairs (L, 2), and its
    total cost.

    `skip`: what an unmatched frame before the path's start or after its end pays; inf = the path
    must run from the first pair of frames to the last. NaN costs count as `skip` (or as the mean
    cost when ends are closed).
    """
    if cost.ndim != 2 or 0 in cost.shape:
        raise ValueError(f"cost: expected a matrix (n, m) with n, m >= 1, got shape {cost.shape}")
    n, m = cost.shape
    unknown = np.isnan(cost)
    if unknown.any():
        known = cost[~unknown]
        cost = np.where(
            unknown, skip if np.isfinite(skip) else (known.mean() if known.size else 0.0), cost
        )
    total, step = _accumulate(cost, skip)
    finish = np.full(total.shape, np.inf)
    finish[n + m - 2, n - 1] = 0.0
    if np.isfinite(skip):
        rows, columns = np.arange(n), np.arange(m)
        finish[rows + m - 1, rows] = skip * (n - 1 - rows)
        finish[n - 1 + columns, n - 1] = skip * (m - 1 - columns)
    ends = total + finish
    d, i = divmod(int(np.argmin(ends)), n)
    best = float(ends[d, i])
    path = [(i, d - i)]
    while d and step[d, i] != _START:
        taken = step[d, i]
        d, i = d - (2 if taken == _DIAGONAL else 1), i - (0 if taken == _RIGHT else 1)
        path.append((i, d - i))
    return np.array(path[::-1], dtype=np.int64), best


def positions_of_rows(path: Path, n: int) -> Array:
    """Where in the columns each of n rows lies: the mean of the columns its path cells name; NaN
    off the path."""
    count = np.bincount(path[:, 0], minlength=n)
    total = np.bincount(path[:, 0], weights=path[:, 1], minlength=n)
    return np.divide(total, count, out=np.full(n, np.nan), where=count > 0)
