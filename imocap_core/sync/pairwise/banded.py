"""Products with soft maps, whose entries vanish away from the warp.

The posterior over monotone warps falls off so fast that most entries of a row are lost in the
rounding of any sum over it. Products without them cost time in proportion to the frames, not to
their square.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

NEGLIGIBLE = 1e-24  # of a row's largest entry; sums are rounded at 1e-16
FRAMES = 32  # of a block; the positions of its band are those of any of its frames


@dataclass(frozen=True)
class BandedMap:
    """A soft map of N frames to S positions, and for each block of frames the positions that are
    not negligible to all of them."""

    soft_map: Float[np.ndarray, "N S"]
    bands: list[tuple[slice, slice]]

    @classmethod
    def of(cls, soft_map: Float[np.ndarray, "N S"]) -> BandedMap:
        bands = []
        for first in range(0, len(soft_map), FRAMES):
            rows = slice(first, min(first + FRAMES, len(soft_map)))
            block = soft_map[rows]
            entries = block > NEGLIGIBLE * block.max(axis=1, keepdims=True)
            (positions,) = np.nonzero(entries.any(axis=0))
            if len(positions):
                bands.append((rows, slice(int(positions[0]), int(positions[-1]) + 1)))
        return cls(soft_map, bands)

    def gathered(self, values: Float[np.ndarray, "S F"]) -> Float[np.ndarray, "N F"]:
        """soft_map @ values: what each frame meets at its positions."""
        out = np.zeros((len(self.soft_map), values.shape[1]))
        for rows, columns in self.bands:
            out[rows] = self.soft_map[rows, columns] @ values[columns]
        return out

    def spread(self, values: Float[np.ndarray, "N F"]) -> Float[np.ndarray, "S F"]:
        """soft_map.T @ values: what the frames bring to each position."""
        out = np.zeros((self.soft_map.shape[1], values.shape[1]))
        for rows, columns in self.bands:
            out[columns] += self.soft_map[rows, columns].T @ values[rows]
        return out
