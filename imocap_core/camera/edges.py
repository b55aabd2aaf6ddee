"""Edges of a picture as chains of points, to a fraction of a pixel.

An edge pixel (Canny, 1986) is moved along the gradient to where it is steepest, and linked with
neighbours whose gradient points the same way. A chain that is not one slight bend is split.
"""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8
from scipy.ndimage import map_coordinates
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

BLUR_PX = 1.0
LOW, HIGH = 3.0, 7.5  # thresholds of the gradient, grey levels a pixel
FINE = 8  # steps of a grey level: OpenCV takes whole numbers
TURN_DEG = 18.0  # between the gradients of neighbours in a chain
ROUGH_PX = 0.6  # root mean square distance from a parabola
BENT = 0.12  # height of the bend over the chain's length, at most
STEPS = ((0, 1), (1, 0), (1, 1), (1, -1))  # to half of the neighbours, row and column


def edge_chains(
    picture: UInt8[np.ndarray, "H W"], background: Bool[np.ndarray, "H W"], least_px: float
) -> list[Float[np.ndarray, "_ 2"]]:
    """Smooth chains of edge points of a grey picture, x and y, in order along the edge.

    Args:
        background: edges elsewhere are left out. least_px: length of the shortest chain.
    """
    smooth = cv2.GaussianBlur(picture.astype(np.float32), (0, 0), BLUR_PX)
    gx, gy = (cv2.Sobel(smooth, cv2.CV_32F, *by, scale=0.125) for by in ((1, 0), (0, 1)))
    fine_x, fine_y = ((FINE * g).astype(np.int16) for g in (gx, gy))
    canny = cv2.Canny(fine_x, fine_y, FINE * LOW, FINE * HIGH, L2gradient=True)
    row, column = np.nonzero((canny > 0) & background)
    inside = (row > 1) & (column > 1) & (row < len(canny) - 2) & (column < canny.shape[1] - 2)
    row, column = row[inside], column[inside]
    gradient = np.stack([gx[row, column], gy[row, column]], axis=1)
    xy = _steepest(np.hypot(gx, gy), row, column, gradient)
    labels = _linked(row, column, gradient, canny.shape)
    chains: list[np.ndarray] = []
    order = np.argsort(labels, kind="stable")
    for part in np.split(order, np.flatnonzero(np.diff(labels[order])) + 1):
        if len(part) >= 0.7 * least_px:
            chains += _smooth_parts(xy[part], least_px)
    return chains


def _steepest(
    strength: Float[np.ndarray, "H W"],
    row: np.ndarray,
    column: np.ndarray,
    gradient: Float[np.ndarray, "N 2"],
) -> Float[np.ndarray, "N 2"]:
    """Edge pixels moved along their gradients to the largest gradient: the top of a parabola."""
    step = gradient / np.maximum(np.linalg.norm(gradient, axis=1, keepdims=True), 1e-6)
    here = np.stack([column, row], axis=1).astype(float)
    before, middle, after = (_sampled(strength, here + k * step) for k in (-1.0, 0.0, 1.0))
    curve = before - 2 * middle + after
    top = np.where(curve < -1e-6, 0.5 * (before - after) / np.minimum(curve, -1e-6), 0.0)
    return np.asarray(here + np.clip(top, -1.0, 1.0)[:, None] * step)


def _sampled(values: Float[np.ndarray, "H W"], xy: Float[np.ndarray, "N 2"]) -> np.ndarray:
    return np.asarray(map_coordinates(values, xy[:, ::-1].T, order=1))


def _linked(
    row: np.ndarray, column: np.ndarray, gradient: Float[np.ndarray, "N 2"], shape: tuple[int, ...]
) -> np.ndarray:
    """The chain of each edge pixel: connected neighbours of about the same gradient direction."""
    number = np.full((shape[0] + 2, shape[1] + 2), -1)
    number[row + 1, column + 1] = np.arange(len(row))
    unit = gradient / np.maximum(np.linalg.norm(gradient, axis=1, keepdims=True), 1e-6)
    pairs = []
    for down, right in STEPS:
        other = number[row + 1 + down, column + 1 + right]
        one = np.flatnonzero(other >= 0)
        alike = (unit[one] * unit[other[one]]).sum(axis=1) > np.cos(np.radians(TURN_DEG))
        pairs.append(np.stack([one[alike], other[one[alike]]]))
    a, b = np.concatenate(pairs, axis=1)
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(len(row), len(row)))
    return np.asarray(connected_components(graph, directed=False)[1])


def _smooth_parts(xy: Float[np.ndarray, "N 2"], least_px: float) -> list[np.ndarray]:
    """A chain, or where it is not one slight bend, its parts."""
    middle = xy.mean(axis=0)
    _, _, axes = np.linalg.svd(xy - middle, full_matrices=False)
    along, across = ((xy - middle) @ axis for axis in axes)
    order = np.argsort(along)
    length = float(along[order[-1]] - along[order[0]])
    if length < least_px:
        return []
    parabola = np.polyfit(along, across, 2)
    off = across - np.polyval(parabola, along)
    rough, bend = float(np.sqrt(np.mean(off**2))), abs(float(parabola[0]))
    if rough <= ROUGH_PX and bend * (length / 2) ** 2 <= BENT * length:
        return [xy[order]]
    if length < 2 * least_px:
        return []
    worst = along[np.argmax(np.abs(off))]
    cut = float(np.clip(worst, along.min() + 0.25 * length, along.max() - 0.25 * length))
    return [
        part for side in (along < cut, along >= cut) for part in _smooth_parts(xy[side], least_px)
    ]
