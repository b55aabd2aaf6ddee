"""How far the maps between videos can be trusted, without any truth.

Maps found pair by pair know nothing of each other. Where going round three videos ends where it
began, they are likely right; where a video's own way to the reference differs from the way through
the others, one of them is wrong.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np
from numpy.typing import NDArray

from imocap_core.sync.blocks import Blocks
from imocap_core.sync.warp.positions import mass_within, median_positions

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PairMaps:
    """Where the frames of each video lie in each other one, pair by pair.

    positions[i, j], confidence[i, j] (T_i,): fractional frames of j, NaN unmatched; in [0, 1].
    """

    positions: dict[tuple[int, int], Array]
    confidence: dict[tuple[int, int], Array]


@dataclass(frozen=True)
class Triple:
    """Going round three videos: mean distance between end and start, in frames of the first and in
    seconds; `share` of the frames that come round at all. NaN where none does."""

    videos: tuple[int, int, int]
    frames: float
    seconds: float
    share: float

    @property
    def numbers(self) -> tuple[float, float, float]:
        """frames, seconds, share."""
        return self.frames, self.seconds, self.share


def pair_maps(
    maps: NDArray[np.floating],
    matched: Array,
    blocks: Blocks,
    fps: Sequence[float],
    reach_s: float,
) -> PairMaps:
    """From soft maps (N_a, N_a) between whole frames and P(matched) (N_a, M)."""
    positions, confidence = {}, {}
    for i, j in permutations(range(len(blocks.lengths)), 2):
        block = np.asarray(blocks.block(maps, i, j), dtype=float)
        seen = matched[blocks.rows(i), j]
        at = median_positions(block)
        sure = mass_within(block, at, reach_s * fps[j]) * seen
        positions[i, j] = np.where(seen >= 0.5, at, np.nan)
        confidence[i, j] = np.where(seen >= 0.5, np.minimum(sure, 1.0), 0.0)
    return PairMaps(positions, confidence)


def followed(start: Array, then: Array) -> Array:
    """Positions (T,) carried on by a map (S,) of whole frames; NaN where either is unmatched."""
    S = len(then)
    low = np.clip(np.floor(np.nan_to_num(start)).astype(int), 0, max(S - 2, 0))
    high = np.minimum(low + 1, S - 1)
    share = np.clip(start - low, 0.0, 1.0)
    between = (1 - share) * then[low] + share * then[high]
    out: Array = np.where(share == 0, then[low], np.where(share == 1, then[high], between))
    return np.where(np.isfinite(start), out, np.nan)


def cycle_residuals(pairs: PairMaps, lengths: Sequence[int], fps: Sequence[float]) -> list[Triple]:
    """All triples a < b < c, each gone round both ways."""
    found = []
    for a, b, c in combinations(range(len(lengths)), 3):
        off, count = [], 0
        for b_, c_ in ((b, c), (c, b)):
            at = followed(pairs.positions[a, b_], pairs.positions[b_, c_])
            back = followed(at, pairs.positions[c_, a])
            off.append(np.abs(back - np.arange(lengths[a])))
            count += lengths[a]
        every = np.concatenate(off)
        every = every[np.isfinite(every)]
        frames = float(every.mean()) if len(every) else float("nan")
        found.append(Triple((a, b, c), frames, frames / fps[a], len(every) / max(count, 1)))
    return found


def left_out_disagreement(
    pairs: PairMaps, lengths: Sequence[int], reference: int
) -> tuple[Array, Array]:
    """Per video (M,), in frames of the reference: how far its own map to the reference lies from
    the maps through each of the others (their median), mean over frames; and the share of frames
    that both ways match. NaN for the reference and where no other video leads there."""
    M = len(lengths)
    frames, share = np.full(M, np.nan), np.full(M, np.nan)
    for v in range(M):
        others = [u for u in range(M) if u not in (v, reference)]
        if v == reference or not others:
            continue
        own = pairs.positions[v, reference]
        ways = np.stack(
            [followed(pairs.positions[v, u], pairs.positions[u, reference]) for u in others]
        )
        some = np.isfinite(ways).any(axis=0)
        through = np.full(lengths[v], np.nan)
        through[some] = np.nanmedian(ways[:, some], axis=0)
        off = np.abs(own - through)
        both = np.isfinite(off)
        share[v] = float(both.mean())
        if both.any():
            frames[v] = float(off[both].mean())
    return frames, share
