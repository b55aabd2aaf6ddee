"""The user's anchors on the axis of the reference video."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from imocap_core.sync.anchors import (
    Anchor,
    AnchorPoint,
    Hints,
    anchored_squares,
    led_through,
    square_per_nat,
)
from imocap_core.sync.map_consistency import PairMaps
from imocap_core.sync.phase import HARD_WEIGHT, WeightedMap
from imocap_core.sync.warp.nearby_squares import NearbySquares

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
