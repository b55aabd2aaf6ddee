"""The plain ways: what one writes first, with the same answers."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int


def procrustes_by_svd(
    poses_a: Float[np.ndarray, "N_a J 3"], poses_b: Float[np.ndarray, "N_b J 3"]
) -> Float[np.ndarray, "N_a N_b"]:
    """Root-mean-square joint distance of every pair after the best rigid alignment, each by a
    singular value decomposition (Kabsch 1976)."""
    centred_a = poses_a - poses_a.mean(axis=1, keepdims=True)
    centred_b = poses_b - poses_b.mean(axis=1, keepdims=True)
    out = np.empty((len(poses_a), len(poses_b)))
    for i, a in enumerate(centred_a):
        for j, b in enumerate(centred_b):
            U, S, Vt = np.linalg.svd(a.T @ b)
            S[2] *= np.sign(np.linalg.det(U @ Vt))
            square = (a**2).sum() + (b**2).sum() - 2 * S.sum()
            out[i, j] = np.sqrt(max(square, 0.0) / len(a))
    return out


def dtw_by_loops(
    a: Float[np.ndarray, " N"], b: Float[np.ndarray, " S"]
) -> tuple[Int[np.ndarray, "L 2"], float]:
    """The cheapest monotone path between two series, squared differences, a diagonal step
    weighing two; the path and its cost."""
    x, y = a.tolist(), b.tolist()
    n, m = len(x), len(y)
    total = [[0.0] * m for _ in range(n)]
    step = [[(0, 0)] * m for _ in range(n)]
    for i in range(n):
        for j in range(m):
            cost = (x[i] - y[j]) ** 2
            options = []
            if i and j:
                options.append((total[i - 1][j - 1] + 2 * cost, (1, 1)))
            if i:
                options.append((total[i - 1][j] + cost, (1, 0)))
            if j:
                options.append((total[i][j - 1] + cost, (0, 1)))
            total[i][j], step[i][j] = min(options) if options else (2 * cost, (0, 0))
    i, j = n - 1, m - 1
    path = [(i, j)]
    while (i, j) != (0, 0):
        i, j = i - step[i][j][0], j - step[i][j][1]
        path.append((i, j))
    return np.array(path[::-1], dtype=np.int64), total[n - 1][m - 1]
