"""The user's anchors on the axis of the reference video."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from imocap_core.sync.anchors import Anchor, Hints, bent, led_through, unit_of
from imocap_core.sync.map_consistency import PairMaps
from imocap_core.sync.phase import FIRM, Link

Array = NDArray[np.float64]

Ties = list[list[tuple[int, float, bool]]]  # per video: own frame, reference frame, hard
# video, squared distances (T_v, S), typical square, looks a second -> squares bent by anchors
Bend = Callable[[int, Array, float, float], Array]


def ties_to_reference(hints: Hints, pairs: PairMaps, count: int, reference: int) -> Ties:
    """Per video its ties to the reference.

    An anchor between two other videos ties both to where they lie in the reference by their own
    maps (by confidence); when neither lies there it ties nothing.
    """
    ties: Ties = [[] for _ in range(count)]
    for x in hints.anchors:
        ends = ((x.a, x.frame_a), (x.b, round(x.frame_b)))
        if reference in (x.a, x.b):
            other = x.b if x.a == reference else x.a
            seen = x.seen_from(other)
            assert seen is not None
            ties[other].append((seen[0], seen[2], x.hard))
            continue
        found = [
            (pairs.positions[v, reference][t], pairs.confidence[v, reference][t]) for v, t in ends
        ]
        middle = _mean(found)
        if np.isfinite(middle):
            for v, t in ends:
                ties[v].append((t, middle, x.hard))
    return ties


def bend_of(ties: Ties, fps: Sequence[float], reference: int, per_frame: int) -> Bend | None:
    """What `posterior_warps` bends squared distances to the reference by; None without ties."""
    if not any(ties):
        return None

    def bend(video: int, squares: Array, near: float, evidence_per_s: float) -> Array:
        return bent(
            squares,
            ties[video],
            near=near,
            unit=unit_of(near, fps[video], evidence_per_s),
            fps_to=fps[reference],
            per_frame=per_frame,
        )

    return bend


def through_hard_anchors(
    frames: Sequence[Array], trust: Sequence[Array], hints: Hints, reference: int
) -> tuple[list[Array], list[Array]]:
    """Maps to the reference led exactly through the hard anchors.

    Two other videos that are tied meet half way (by confidence); where neither lies in the
    reference there is nothing to lead.
    """
    points: list[dict[int, float]] = [{} for _ in frames]
    for x in (x for x in hints.anchors if x.hard):
        ends = ((x.a, x.frame_a), (x.b, round(x.frame_b)))
        if reference in (x.a, x.b):
            other = x.b if x.a == reference else x.a
            seen = x.seen_from(other)
            assert seen is not None
            points[other][seen[0]] = seen[2]
            continue
        middle = _mean([(frames[v][t], trust[v][t]) for v, t in ends])
        if np.isfinite(middle):
            for v, t in ends:
                points[v].setdefault(t, middle)
    out = [
        led_through(f, c, _in_order(p)) if p else (f, c)
        for f, c, p in zip(frames, trust, points, strict=True)
    ]
    return [f for f, _ in out], [c for _, c in out]


def firm_links(anchors: Sequence[Anchor], lengths: Sequence[int]) -> list[Link]:
    """The hard anchors as equations of the common time axis that must hold."""
    links = []
    for x in (x for x in anchors if x.hard):
        position, weight = np.full(lengths[x.a], np.nan), np.zeros(lengths[x.a])
        position[x.frame_a], weight[x.frame_a] = x.frame_b, FIRM
        links.append(Link(x.a, x.b, position, weight))
    return links


def _mean(found: Sequence[tuple[float, float]]) -> float:
    known = [(at, max(sure, 1e-3)) for at, sure in found if np.isfinite(at)]
    if not known:
        return float("nan")
    return float(np.average([at for at, _ in known], weights=[sure for _, sure in known]))


def _in_order(points: dict[int, float]) -> list[tuple[int, float]]:
    rows = sorted(points)
    return list(zip(rows, np.maximum.accumulate([points[r] for r in rows]).tolist(), strict=True))
