"""Maps to the reference, refined on several time axes and averaged.

In the loop one axis is enough, the reference's: each video's own keypoints tell its time there. On
another video's time its wrong poses would speak too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.params import SyncParams
from imocap_core.sync.anchors import Hints
from imocap_core.sync.axis_average import averaged_over_axes, axes_of
from imocap_core.sync.block_maps import BlockMaps
from imocap_core.sync.map_consistency import PairMaps
from imocap_core.sync.pairwise.distance_matrix import DistanceMatrix
from imocap_core.sync.reference_anchors import anchor_penalty, anchors_to_reference
from imocap_core.sync.refinement import ReferenceAxis, refined_warps
from imocap_core.sync.warp.clocks import Clocks
from imocap_core.sync.warp.reprojection import ReprojectionEvidence
from imocap_core.workers import at_once

MEMORY_BYTES = 1 << 28  # of the maps of all axes that are refined at once
COPIES = 4  # of all maps, while they are refined

# On training clips anything from 0.2 s on gives the same error; steps and dribbles last longer.
REACH_S = 0.3


@dataclass(frozen=True)
class AxisChoice:
    """The videos whose time may serve as axis: the reference, then others by centrality."""

    clocks: Clocks
    hints: Hints
    pairs: PairMaps
    reference: int
    centralities: Float[np.ndarray, " M"]

    def axis(self, v: int, distances: DistanceMatrix, params: SyncParams) -> ReferenceAxis:
        """The axis of one video, with the user's anchors on it."""
        points = anchors_to_reference(self.hints, self.pairs, len(self.centralities), v)
        fps = self.clocks.action_fps
        penalty = anchor_penalty(points, fps, v, params.positions_per_frame)
        reach_frames = params.confidence_reach_s * self.clocks.fps[v]
        return ReferenceAxis(v, self.clocks, reach_frames, distances.change, penalty)


def refined_over_axes(
    choice: AxisChoice,
    distances: DistanceMatrix,
    relaxed: BlockMaps,
    matched: Float[np.ndarray, "N_a M"],
    params: SyncParams,
    reprojection: ReprojectionEvidence | None,
) -> tuple[list[Float[np.ndarray, "_T"]], list[Float[np.ndarray, "_T"]], ReferenceAxis]:
    """Positions of all videos' frames in the reference, averaged over axes (`averaged_over_axes`);
    the mass of their soft maps to the reference alone, and its axis."""
    videos = axes_of(choice.reference, choice.centralities)
    if reprojection is not None:
        videos = [choice.reference]
    axes = [choice.axis(v, distances, params) for v in videos]
    refined = at_once(
        lambda axis: refined_warps(distances, relaxed, matched, axis, params, reprojection),
        axes,
        _axes_at_once(relaxed, choice.reference, params),
    )
    maps = {v: positions for v, (positions, _) in zip(videos, refined, strict=True)}
    lengths = [len(x) for x in distances.poses]
    reach_frames = REACH_S * choice.clocks.fps[choice.reference]
    averaged = averaged_over_axes(maps, choice.reference, lengths, reach_frames)
    return averaged, refined[0][1], axes[0]


def _axes_at_once(relaxed: BlockMaps, reference: int, params: SyncParams) -> int:
    """As many axes as fit into the memory for them, one at least."""
    videos = range(len(relaxed.blocks.lengths))
    entries = sum(x.size for v in videos for x in relaxed.pair(v, reference).values)
    of_axis = COPIES * np.dtype(float).itemsize * params.positions_per_frame * entries
    return max(1, MEMORY_BYTES // max(1, of_axis))
