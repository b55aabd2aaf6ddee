"""Radial distortion of a camera that stands, estimated from straight lines of the scene.

Edges of a picture as chains of points, to a fraction of a pixel. An edge pixel (Canny, 1986) is
moved along the gradient to where it is steepest, and linked with neighbours whose gradient points
the same way. A chain that is not one slight bend is split.

The background of a camera that stands, without the person who moves before it: a median. Plumb-line
calibration (Brown, 1971) with one coefficient about the middle of the picture: without the
distortion, as much of the picture's edges as possible is straight. Chains of edges are weighted by
their length, robustly: what is round is round through any lens. The uncertainty comes from drawing
parts of the picture at random (bootstrap), as lines of one thing err together.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from scipy.ndimage import map_coordinates
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from imocap_core.camera.background import background_mask, filled_boxes
from imocap_core.camera.projection import Lens, lens_of_corner
from imocap_core.robust import geman_mcclure

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
    before, middle, after = (
        map_coordinates(strength, (here + k * step)[:, ::-1].T, order=1) for k in (-1.0, 0.0, 1.0)
    )
    curve = before - 2 * middle + after
    top = np.where(curve < -1e-6, 0.5 * (before - after) / np.minimum(curve, -1e-6), 0.0)
    return np.asarray(here + np.clip(top, -1.0, 1.0)[:, None] * step)


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


MOST = 15  # pictures
FEWEST_OF_A_PIXEL = 2  # pictures that show the background there


@dataclass(frozen=True)
class StillBackground:
    """A grey picture, and where it is background: where the person is not always in front of it."""

    picture: UInt8[np.ndarray, "H W"]
    is_background: Bool[np.ndarray, "H W"]


@dataclass(frozen=True)
class KeptPictures:
    """Some of a video's T pictures, evenly over it, filled as the video is read once."""

    count: int
    by_frame: dict[int, UInt8[np.ndarray, "H W"]]

    def passing(self, pictures: Iterable[UInt8[np.ndarray, "H W"]]) -> Iterator[np.ndarray]:
        """The pictures, unchanged; some are sampled."""
        wanted = set(np.linspace(0, self.count - 1, MOST).astype(int).tolist())
        for frame, picture in enumerate(pictures):
            if frame in wanted:
                self.by_frame[frame] = picture
            yield picture


def still_background(sampled: KeptPictures, box_px: Float[np.ndarray, "T 4"]) -> StillBackground:
    """The median of the kept pictures, each without the person's padded box.

    Args:
        box_px: x0, y0, x1, y1 of the person in pixels of these pictures; NaN where unknown.
    """
    boxes = filled_boxes(box_px)
    pictures = list(sampled.by_frame.values())
    masks = [background_mask(p.shape, boxes[t]) > 0 for t, p in sampled.by_frame.items()]
    return _median(pictures, masks)


def _median(pictures: Sequence[np.ndarray], masks: Sequence[np.ndarray]) -> StillBackground:
    shown = np.stack(masks)
    ordered = np.sort(np.where(shown, np.stack(pictures).astype(np.int16), 256), axis=0)
    count = shown.sum(axis=0)
    middle = np.take_along_axis(ordered, np.maximum(count - 1, 0)[None] // 2, axis=0)[0]
    least = min(FEWEST_OF_A_PIXEL, len(pictures))
    return StillBackground(np.minimum(middle, 255).astype(np.uint8), count >= least)


TRIED = np.arange(-0.14, 0.1001, 0.004)  # `LineLens.distortion`
SHORTEST = 0.06  # chain, as a share of the picture's larger side
STRAIGHT_PX = 0.5  # root mean square distance of a chain's points from a line
PARTS = 4  # the picture in so many columns and rows: parts, of which each may mislead
DRAWS = 200
SPEAKING = 0.02  # of the whole gain: a part that has less says nothing
LEAST = 0.03  # displacement of the picture's corner, as a share, that is worth correcting
CERTAIN_SIGMAS = 4.0
LEAST_GAIN = 0.08
FEWEST_PARTS = 3
MOST_AGAINST = 0.15
MODEL_SD = 0.005  # of the distortion: lenses of more than one coefficient, off the middle


@dataclass(frozen=True)
class LineLens:
    """The estimate from the lines of a picture.

    Attributes:
        distortion: displacement of the corner over its distance from the middle, first order (k1
            for a focal length of half the diagonal); sd: its standard deviation.
        gain: share of the bent edges' robust cost that it removes.
        parts: number of parts of the picture that speak for it; against: what others lose, as a
            share of what these gain.
    """

    source: ClassVar[Literal["lines"]] = "lines"

    distortion: float
    sd: float
    gain: float
    parts: int
    against: float

    @property
    def certain(self) -> bool:
        """Whether the evidence is clear enough to correct the pictures."""
        return bool(
            abs(self.distortion) >= max(LEAST, CERTAIN_SIGMAS * self.sd)
            and TRIED[0] < self.distortion < TRIED[-1]
            and self.gain >= LEAST_GAIN
            and self.parts >= FEWEST_PARTS
            and self.against <= MOST_AGAINST
        )

    def lens(self, K: Float[np.ndarray, "3 3"], size: tuple[int, int]) -> tuple[Lens, float]:
        """The lens of pictures of a size whose focal length is K's, and the standard deviation of
        its k1."""
        return lens_of_corner(self.distortion, self.sd, K, size)


def lens_from_lines(still: StillBackground) -> LineLens | None:
    """The lens of a standing camera by its background; None where there are hardly any edges."""
    height, width = still.picture.shape
    chains = edge_chains(still.picture, still.is_background, SHORTEST * max(height, width))
    return line_lens(chains, (width, height))


def line_lens(chains: Sequence[Float[np.ndarray, "_ 2"]], size: tuple[int, int]) -> LineLens | None:
    """The distortion under which most edges are straight; None where there are hardly any edges."""
    if len(chains) < 3:
        return None
    length = np.array([len(chain) for chain in chains], float)
    cost = np.asarray(geman_mcclure(_bends_px(chains, size) ** 2, STRAIGHT_PX)[0]) * length[:, None]
    part = _parts(chains, size)
    per_part = np.stack([cost[part == p].sum(axis=0) for p in range(PARTS**2)])
    best = _lowest(per_part.sum(axis=0))
    rng = np.random.default_rng(0)
    drawn = rng.multinomial(PARTS**2, np.full(PARTS**2, PARTS**-2.0), size=DRAWS)
    spread = np.std([_lowest(total) for total in drawn @ per_part])
    straight, bent = (int(np.argmin(np.abs(TRIED - d))) for d in (0.0, best))
    gains = per_part[:, straight] - per_part[:, bent]
    return LineLens(
        best,
        float(np.hypot(spread, MODEL_SD)),
        float(gains.sum() / max(per_part[:, straight].sum(), 1e-9)),
        int((gains > SPEAKING * gains.clip(0).sum()).sum()),
        float(-gains.clip(max=0).sum() / max(gains.clip(0).sum(), 1e-9)),
    )


def _bends_px(
    chains: Sequence[Float[np.ndarray, "_ 2"]], size: tuple[int, int]
) -> Float[np.ndarray, "C D"]:
    """Root mean square distance of each chain's points from a line, without each distortion of
    TRIED, in pixels of the picture."""
    points = np.concatenate(chains)
    count = np.array([len(chain) for chain in chains])
    bends = []
    for distortion in TRIED:
        lens = centred_lens(distortion, size)
        foot = lens.distorted(on_lines(lens.undistorted(points), count))
        squared = ((foot - points) ** 2).sum(axis=1)
        bends.append(np.sqrt(np.add.reduceat(squared, np.cumsum(count) - count) / count))
    return np.stack(bends, axis=1)


def centred_lens(distortion: float, size: tuple[int, int]) -> Lens:
    """The lens of a displacement of the picture's corners."""
    middle = (np.array(size) - 1) / 2
    radius = float(np.linalg.norm(middle))
    K = np.array([[radius, 0, middle[0]], [0, radius, middle[1]], [0, 0, 1.0]])
    return Lens.of([distortion], K)


def on_lines(
    points: Float[np.ndarray, "N 2"], count: Int[np.ndarray, " C"]
) -> Float[np.ndarray, "N 2"]:
    """The nearest points on the line of each chain (total least squares)."""
    starts = np.cumsum(count) - count
    off = points - np.repeat(np.add.reduceat(points, starts) / count[:, None], count, axis=0)
    products = np.stack([off[:, 0] ** 2, off[:, 1] ** 2, off[:, 0] * off[:, 1]], axis=1)
    xx, yy, xy = np.add.reduceat(products, starts).T
    angle = np.repeat(0.5 * np.arctan2(2 * xy, xx - yy), count)
    normal = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    return np.asarray(points - (off * normal).sum(axis=1, keepdims=True) * normal)


def _parts(chains: Sequence[Float[np.ndarray, "_ 2"]], size: tuple[int, int]) -> np.ndarray:
    """The part of the picture that each chain's middle is in."""
    middle = np.array([chain.mean(axis=0) for chain in chains]) / np.array(size)
    cell = np.clip((PARTS * middle).astype(int), 0, PARTS - 1)
    return np.asarray(PARTS * cell[:, 1] + cell[:, 0])


def _lowest(total: Float[np.ndarray, " D"]) -> float:
    """Where a sampled cost is lowest, between the samples."""
    k = int(np.argmin(total))
    if not 0 < k < len(total) - 1:
        return float(TRIED[k])
    before, here, after = total[k - 1 : k + 2]
    curve = before - 2 * here + after
    return float(TRIED[k] + (TRIED[1] - TRIED[0]) * 0.5 * (before - after) / max(curve, 1e-12))
