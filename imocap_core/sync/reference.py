"""The reference video: the central one, from every video compared with every other.

Of many videos each is compared with a few central ones, the hubs, alone, so that time grows with
the videos and not with their pairs. One of the hubs is the reference.

The reference video: of the central ones, to which the frames of the others are most similar, and
which lack nothing of their motion, the one that goes most steadily through the action. Centralities
of good videos lie close together, and noise decides between them. Of good videos any may be the
reference (docs/sync.md); the loop chooses by joint motions, in which wrong monocular ones have been
put right (docs/decisions.md).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import permutations

import numpy as np
from jaxtyping import Bool, Float

from imocap_core.params import SyncParams
from imocap_core.sync.affinity import DistanceMatrix
from imocap_core.sync.anchors import (
    Anchor,
    AnchorPoint,
    Hints,
    anchored_squares,
    led_through,
    square_per_nat,
)
from imocap_core.sync.maps import BandedMap, BlockMaps
from imocap_core.sync.time_axis import HARD_WEIGHT, PairMaps, WeightedMap, map_of_pair
from imocap_core.sync.warp.soft_maps import Clocks, pairwise_soft_map
from imocap_core.sync.warp.template import NearbySquares

NEAR = 0.8  # of the largest centrality: harmless changes move one against another by a tenth
LACKING = 0.2  # of the others' motion, more than another video: repetitions, for example
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


def chosen_reference(
    centralities: Float[np.ndarray, " M"],
    pace_spreads: Float[np.ndarray, " M"],
    shown: Float[np.ndarray, " M"],
    eligible: Sequence[bool] | Bool[np.ndarray, " M"],
) -> int:
    """Index of the video of steadiest pace, and then the most central, among those whose centrality
    is within NEAR of the largest and that show as much of the others' motion as any.

    Args:
        pace_spreads, shown: see `pace_spread` and `shown_motion`.
        eligible: the videos to choose from; all, if none is.
    """
    able = np.array(eligible) if any(eligible) else np.ones(len(centralities), dtype=bool)
    central = able & (centralities >= NEAR * centralities[able].max())
    showing = central & (shown >= shown[central].max() - LACKING)
    steady = showing & (pace_spreads <= pace_spreads[showing].min() + STEADY)
    return int(np.argmax(np.where(steady, centralities, -1.0)))


# video, squared distances (T_v, S), typical square, observations a second
#   -> squared distances with the penalties of the user's anchors
AnchorPenalty = Callable[[int, NearbySquares, float, float], NearbySquares]


def anchors_to_reference(
    hints: Hints, pairs: PairMaps, count: int, reference: int
) -> list[list[AnchorPoint]]:
    """Per video the anchors that concern it, as positions of the reference.

    An anchor between two other videos ties both to the position that their maps to the reference
    give (mean by confidence); when neither is matched there it ties nothing.
    """
    points: list[list[AnchorPoint]] = [[] for _ in range(count)]
    for anchor in hints.anchors:
        for video, frame, position in _on_reference(
            anchor, reference, lambda v, t: _pair_position(pairs, v, reference, t)
        ):
            points[video].append(AnchorPoint(frame, position, anchor.hard))
    return points


def _pair_position(pairs: PairMaps, v: int, reference: int, t: int) -> tuple[float, float]:
    return pairs.positions[v, reference][t], pairs.confidence[v, reference][t]


def _on_reference(
    anchor: Anchor, reference: int, position_of: Callable[[int, int], tuple[float, float]]
) -> list[tuple[int, int, float]]:
    """(video, frame, position in the reference) that an anchor ties together.

    `position_of` gives position and confidence of a video's frame in the reference.
    """
    if reference in (anchor.a, anchor.b):
        other = anchor.b if anchor.a == reference else anchor.a
        from_other = anchor.from_video(other)
        assert from_other is not None
        return [(other, from_other[0], from_other[2])]
    ends = ((anchor.a, anchor.frame_a), (anchor.b, round(anchor.frame_b)))
    middle = _mean([position_of(v, t) for v, t in ends])
    return [(v, t, middle) for v, t in ends] if np.isfinite(middle) else []


def anchor_penalty(
    points: Sequence[Sequence[AnchorPoint]], fps: Sequence[float], reference: int, per_frame: int
) -> AnchorPenalty | None:
    """The penalty that `refined_warps` adds to squared distances to the reference; None without
    anchors."""
    if not any(points):
        return None

    def penalty(
        video: int, squares: NearbySquares, matched_square: float, evidence_per_s: float
    ) -> NearbySquares:
        if not points[video]:
            return squares
        penalised = anchored_squares(
            squares.nearby.dense(),  # all positions are near where there are anchors
            points[video],
            matched_square=matched_square,
            nat=square_per_nat(matched_square, fps[video], evidence_per_s),
            fps_to=fps[reference],
            per_frame=per_frame,
        )
        return NearbySquares.of(penalised)

    return penalty


def through_hard_anchors(
    positions: Sequence[Float[np.ndarray, "_T"]],
    confidence: Sequence[Float[np.ndarray, "_T"]],
    hints: Hints,
    reference: int,
) -> tuple[list[Float[np.ndarray, "_T"]], list[Float[np.ndarray, "_T"]]]:
    """Maps to the reference led exactly through the hard anchors.

    Two other videos that are tied meet half way (by confidence); where neither is matched in the
    reference the anchor has no effect here.
    """
    points: list[dict[int, float]] = [{} for _ in positions]
    for anchor in (x for x in hints.anchors if x.hard):
        direct = reference in (anchor.a, anchor.b)
        for video, frame, position in _on_reference(
            anchor, reference, lambda v, t: (positions[v][t], confidence[v][t])
        ):
            if direct:
                points[video][frame] = position
            else:
                points[video].setdefault(frame, position)
    out = [
        led_through(f, c, _in_order(p)) if p else (f, c)
        for f, c, p in zip(positions, confidence, points, strict=True)
    ]
    return [f for f, _ in out], [c for _, c in out]


def hard_anchor_maps(anchors: Sequence[Anchor], lengths: Sequence[int]) -> list[WeightedMap]:
    """The hard anchors as equations of the common time axis that must hold."""
    maps = []
    for x in (x for x in anchors if x.hard):
        position, weight = np.full(lengths[x.a], np.nan), np.zeros(lengths[x.a])
        position[x.frame_a], weight[x.frame_a] = x.frame_b, HARD_WEIGHT
        maps.append(WeightedMap(x.a, x.b, position, weight))
    return maps


def _mean(positions: Sequence[tuple[float, float]]) -> float:
    """Mean of (position, confidence) by confidence; NaN where no position is finite."""
    valid = [(p, max(confidence, 1e-3)) for p, confidence in positions if np.isfinite(p)]
    if not valid:
        return float("nan")
    return float(np.average([p for p, _ in valid], weights=[c for _, c in valid]))


def _in_order(points: dict[int, float]) -> list[tuple[int, float]]:
    """Points (frame, position) sorted by frame, positions non-decreasing."""
    rows = sorted(points)
    return list(zip(rows, np.maximum.accumulate([points[r] for r in rows]).tolist(), strict=True))


_MOST_HUBS = 8  # videos that all others are compared with, where there are more than twice as many


def hubs_of(
    distances: DistanceMatrix, eligible: Sequence[bool], reference: int | None
) -> list[int]:
    """The videos that every other one is compared with: all, or of many those whose poses are
    nearest to the others'.

    Args:
        eligible: those to prefer; reference: is one of them, where it is given.
    """
    M = len(distances.poses)
    if M <= 2 * _MOST_HUBS:
        return list(range(M))
    far = np.zeros(M)
    for u, v in permutations(range(M), 2):
        nearest = np.min(np.nan_to_num(distances.block(u, v), nan=np.inf), axis=1)
        far[v] += float(np.minimum(nearest, distances.unrelated_square).mean())
    far += np.where(eligible, 0.0, far.max())
    if reference is not None:
        far[reference] = -1.0
    return sorted(np.argsort(far, kind="stable")[:_MOST_HUBS].tolist())


@dataclass(frozen=True)
class PairComparison:
    """Maps between all videos; of many, from and to the hubs.

    Attributes:
        soft_maps: P(position in another video | frame).
        matched: P(frame has a counterpart in a video).
        pairs: medians of the soft maps.
        centralities: of each video, in [0, 1]: the mean over the other videos of
            `mean_similarity`.
    """

    soft_maps: BlockMaps
    matched: Float[np.ndarray, "N_a M"]
    pairs: PairMaps
    centralities: Float[np.ndarray, " M"]


def compared_pairs(
    distances: DistanceMatrix, clocks: Clocks, params: SyncParams, hubs: Sequence[int]
) -> PairComparison:
    """One pair after another; soft maps are stored as bands, in single precision."""
    blocks, M = distances.blocks, len(distances.poses)
    matched, similarity = np.ones((blocks.total, M)), np.full((M, M), np.nan)
    soft_maps: dict[tuple[int, int], BandedMap] = {}
    positions, confidence = {}, {}
    for i, j in permutations(range(M), 2):
        if i not in hubs and j not in hubs:
            continue
        soft_map, p_matched = pairwise_soft_map(i, j, distances, clocks, params)
        reach = params.confidence_reach_s * clocks.action_fps[j]
        positions[i, j], confidence[i, j] = map_of_pair(soft_map, p_matched, reach)
        soft_map = soft_map.trimmed()
        squares = partial(distances.part, i, j)
        similarity[i, j] = mean_similarity(soft_map, p_matched, squares, distances)
        matched[blocks.rows(i), j] = p_matched
        soft_maps[i, j] = soft_map.astype(np.float32)
    centralities = np.nanmean(similarity, axis=0) if M > 1 else np.ones(1)
    return PairComparison(
        BlockMaps(blocks, soft_maps), matched, PairMaps(positions, confidence), centralities
    )
