"""Consistency of the pairwise maps: cycle residuals and leave-one-out disagreement, without truth.

Maps that are computed pair by pair are independent of each other. Where a cycle of three videos
ends where it began, they are likely right; where a video's direct map to the reference differs from
the maps through the other videos, one of them is wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Float

from imocap_core.sync.pairwise.banded import BandedMap
from imocap_core.sync.warp.positions import mass_within, median_positions


@dataclass(frozen=True)
class PairMaps:
    """Maps from every video to every other one, pair by pair.

    Attributes:
        positions: [i, j]: fractional frames of j for the frames of i, NaN unmatched.
        confidence: [i, j]: in [0, 1].
    """

    positions: dict[tuple[int, int], Float[np.ndarray, "_T"]]
    confidence: dict[tuple[int, int], Float[np.ndarray, "_T"]]


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
    """All triples of videos a < b < c, each cycle in both directions."""
    residuals = []
    for a, b, c in combinations(range(len(lengths)), 3):
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
        others = [u for u in range(M) if u not in (v, reference)]
        if v == reference or not others:
            continue
        direct = pairs.positions[v, reference]
        indirect = np.stack(
            [composed(pairs.positions[v, u], pairs.positions[u, reference]) for u in others]
        )
        some = np.isfinite(indirect).any(axis=0)
        through = np.full(lengths[v], np.nan)
        through[some] = np.nanmedian(indirect[:, some], axis=0)
        distance = np.abs(direct - through)
        both = np.isfinite(distance)
        share[v] = float(both.mean())
        if both.any():
            frames[v] = float(distance[both].mean())
    return frames, share
