"""Squared distances of a video's frames to the positions near their present ones.

Which position fits a frame is a question of those that its soft map does not rule out; how well
the best one fits is judged by the best of all. So all distances are computed, a few frames at a
time, and the band about the map is stored.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from imocap_core.sync.pairwise.banded import Band, BandedMap, whole_band

ENTRIES_AT_ONCE = 1 << 20
# with more pairs of frame and position than that the best of all is that of every n-th position
ALL_COMPARED = 1 << 24


@dataclass(frozen=True)
class NearbySquares:
    """Squared distances in a band that every frame has; NaN unknown.

    Attributes:
        least: each frame's smallest one, over all positions; NaN where none is known.
    """

    nearby: BandedMap
    least: Float[np.ndarray, " N"]

    @classmethod
    def of(cls, squares: Float[np.ndarray, "N S"]) -> NearbySquares:
        """All positions."""
        return cls(whole_band(squares), least_of_rows(squares))

    @classmethod
    def computed(
        cls,
        shape: tuple[int, int],
        bands: Sequence[Band],
        squares: Callable[[slice, slice], Float[np.ndarray, "_n _s"]],
    ) -> NearbySquares:
        """From a function of frames and positions."""
        (N, S), least, values = shape, np.empty(shape[0]), []
        every = -(-N * S // ALL_COMPARED)
        rows_at_once = max(1, ENTRIES_AT_ONCE // max(1, S // every))
        for group in _grouped(bands, rows_at_once):
            rows = slice(group[0][0].start, group[-1][0].stop)
            far = squares(rows, slice(0, S, every))
            least[rows] = least_of_rows(far)
            for frames, positions in group:
                part = slice(frames.start - rows.start, frames.stop - rows.start)
                if every == 1:
                    values.append(far[part, positions].copy())
                else:
                    values.append(squares(frames, positions))
                    least[frames] = np.fmin(least[frames], least_of_rows(values[-1]))
        return cls(BandedMap(shape, bands, values), least)

    def plus(self, further: Callable[[slice, slice], Float[np.ndarray, "_n _s"]]) -> NearbySquares:
        """With further squared distances; each frame's smallest one is of the nearby positions."""
        both = self.nearby.mapped(lambda rows, columns, x: x + further(rows, columns))
        least = np.full(len(self.least), np.nan)
        for rows, _, values in both:
            least[rows] = least_of_rows(values)
        return NearbySquares(both, least)

    def divided(self, by: Float[np.ndarray, " N"]) -> NearbySquares:
        """Every frame's in units of its number."""
        return replace(self, nearby=self.nearby.scaled(1.0 / by), least=self.least / by)


def least_of_rows(squares: Float[np.ndarray, "N S"]) -> Float[np.ndarray, " N"]:
    """The smallest known one of each row; NaN where none is."""
    least = np.fmin.reduce(squares, axis=1)
    return np.asarray(least)


def _grouped(bands: Sequence[Band], rows: int) -> list[list[Band]]:
    """Successive bands, of so many frames together or of one band."""
    groups: list[list[Band]] = []
    for band in bands:
        if groups and band[0].stop - groups[-1][0][0].start <= rows:
            groups[-1].append(band)
        else:
            groups.append([band])
    return groups
