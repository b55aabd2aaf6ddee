"""The reference video: of the central ones, to which the frames of the others are most similar, the
one that shows most of them; of several that do, the one that goes most steadily through the action.

Centralities of good videos lie close together, and noise decides between them; how much of the
others a video shows it leaves alone. Of good videos any may be the reference (docs/sync.md); the
loop chooses by joint motions, in which wrong monocular ones have been put right
(docs/decisions.md).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from imocap_core.sync.blocks import Blocks
from imocap_core.sync.pairwise.banded import BandedMap
from imocap_core.sync.pairwise.distance_matrix import DistanceMatrix

NEAR = 0.8  # of the largest centrality: harmless changes move one against another by a tenth
EQUAL = 0.01  # difference of coverages that are the same
STEADY = 0.05  # difference of pace spreads that are the same


def mean_similarity(
    soft_map: BandedMap,
    matched: Float[np.ndarray, " N"],
    squares: Callable[[slice, slice], Float[np.ndarray, "_n _s"]],
    distances: DistanceMatrix,
) -> float:
    """Mean over a video's frames of P(it has a counterpart in another video) x similarity of that
    counterpart, exp(-d^2 / (2 matched_square)).

    Args:
        soft_map: P(frame of the other video | frame).
        matched: P(frame has a counterpart there).
        squares: squared distances of frames to frames of the other video, NaN unknown.
    """
    expected = np.zeros(len(matched))
    for rows, columns, values in soft_map:
        square = np.nan_to_num(squares(rows, columns), nan=distances.unrelated_square)
        expected[rows] = (values * square).sum(axis=1)
    similarity = np.exp(-0.5 * expected / distances.matched_square)
    return float(np.mean(matched * similarity))


def coverage(matched: Float[np.ndarray, "N_a M"], blocks: Blocks) -> Float[np.ndarray, " M"]:
    """Share of the other videos' frames that have a counterpart in each video, mean over videos.

    Args:
        matched: P(frame has a counterpart in a video).
    """
    M = len(blocks.lengths)
    share = np.array([matched[blocks.rows(u)].mean(axis=0) for u in range(M)])
    np.fill_diagonal(share, 0.0)
    return np.asarray(share.sum(axis=0) / max(M - 1, 1))


def chosen_reference(
    centralities: Float[np.ndarray, " M"],
    pace_spreads: Float[np.ndarray, " M"],
    coverages: Float[np.ndarray, " M"],
    eligible: Sequence[bool],
) -> int:
    """Index of the video that shows most of the others, among those whose centrality is within NEAR
    of the largest; of several, the one of steadiest pace, and then the most central.

    Args:
        pace_spreads: see `pace_spread`.
        eligible: the videos to choose from; all, if none is.
    """
    able = np.array(eligible) if any(eligible) else np.ones(len(centralities), dtype=bool)
    central = able & (centralities >= NEAR * centralities[able].max())
    covering = central & (coverages >= coverages[central].max() - EQUAL)
    steady = covering & (pace_spreads <= pace_spreads[covering].min() + STEADY)
    return int(np.argmax(np.where(steady, centralities, -1.0)))
