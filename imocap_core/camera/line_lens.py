"""Radial distortion of a camera that stands, estimated from straight lines of the scene.

Plumb-line calibration (Brown, 1971) with one coefficient about the middle of the picture: without
the distortion, as much of the picture's edges as possible is straight. Chains of edges are weighted
by their length, robustly: what is round is round through any lens. The uncertainty comes from
drawing parts of the picture at random (bootstrap), as lines of one thing err together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from jaxtyping import Float, Int

from imocap_core.camera.edges import edge_chains
from imocap_core.camera.lens import Lens, lens_of_corner
from imocap_core.camera.still_background import StillBackground
from imocap_core.robust import geman_mcclure

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
    cost = np.asarray(geman_mcclure(bends_px(chains, size) ** 2, STRAIGHT_PX)[0]) * length[:, None]
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


def bends_px(
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
