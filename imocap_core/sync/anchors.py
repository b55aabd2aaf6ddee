"""Anchors: frames that show the same moment, given by the user; and spans without a counterpart.

An anchor ties frame t of one video to frame s of another. It adds a penalty to the squared
distances that every warp is computed from: a soft anchor as strong evidence among the rest, a hard
one as strong as evidence may be, and finally the map is led through a hard anchor exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from imocap_core.sync.affinity import DistanceMatrix
from imocap_core.sync.warp.soft_maps import observations_per_frame

SOFT_NATS, HARD_NATS = 10.0, 60.0  # how much less likely than the anchor any far position is
REACH_S = 0.15  # at this distance from the anchor a position is that much less likely


@dataclass(frozen=True)
class Anchor:
    """Frame `frame_a` of video `a` shows the moment of frame `frame_b` of video `b`; videos and
    frames by index, `frame_b` may be fractional."""

    a: int
    frame_a: int
    b: int
    frame_b: float
    hard: bool = False

    def from_video(self, video: int) -> tuple[int, int, float] | None:
        """The video's frame, the other video, and the other's frame; None for a third video."""
        if video == self.a:
            return self.frame_a, self.b, self.frame_b
        if video == self.b:
            return round(self.frame_b), self.a, float(self.frame_a)
        return None


@dataclass(frozen=True)
class AnchorPoint:
    """An anchor in one map: the row (frame of the one video) lies at a position of the other."""

    row: int
    position: float
    hard: bool


@dataclass(frozen=True)
class Hints:
    """All hints of the user; `forbidden`: (video, first frame, one past the last)."""

    anchors: tuple[Anchor, ...] = ()
    forbidden: tuple[tuple[int, int, int], ...] = ()

    def forbidden_frames(self, lengths: Sequence[int]) -> list[Bool[np.ndarray, "_T"]]:
        """Per video: the frames that match nothing."""
        out = [np.zeros(n, dtype=bool) for n in lengths]
        for video, first, stop in self.forbidden:
            out[video][first:stop] = True
        return out

    def among(self, videos: Sequence[int]) -> Hints:
        """The hints that concern only these videos, renumbered in their order."""
        new = {v: k for k, v in enumerate(videos)}
        return Hints(
            tuple(
                Anchor(new[x.a], x.frame_a, new[x.b], x.frame_b, x.hard)
                for x in self.anchors
                if x.a in new and x.b in new
            ),
            tuple((new[v], a, b) for v, a, b in self.forbidden if v in new),
        )


def check_hints(hints: Hints, lengths: Sequence[int]) -> None:
    """Raise a ValueError that names every hint of a video or frame that does not exist, and every
    two anchors that cross each other in time."""
    M, faults = len(lengths), []
    for n, anchor in enumerate(hints.anchors):
        for video, frame in ((anchor.a, anchor.frame_a), (anchor.b, anchor.frame_b)):
            if not 0 <= video < M:
                faults.append(f"anchor {n + 1}: expected a video 0 to {M - 1}, got {video}")
            elif not 0 <= frame <= lengths[video] - 1:
                faults.append(
                    f"anchor {n + 1}: expected a frame 0 to {lengths[video] - 1} of video {video}, "
                    f"got {frame:g}"
                )
        if anchor.a == anchor.b:
            faults.append(f"anchor {n + 1}: ties video {anchor.a} to itself")
    for video, first, stop in hints.forbidden:
        if not 0 <= video < M or not 0 <= first < stop <= lengths[video]:
            faults.append(f"forbidden: video {video} has no frames {first} to {stop - 1}")
    faults += [
        f"anchors {m + 1} and {n + 1} cross in time: video {y.a}'s later frame is tied to video "
        f"{y.b}'s earlier one"
        for m, x in enumerate(hints.anchors)
        for n, y in enumerate(hints.anchors)
        if m < n and _cross(x, y)
    ]
    if faults:
        raise ValueError("; ".join(faults))


def _cross(x: Anchor, y: Anchor) -> bool:
    from_y = x.from_video(y.a)
    if from_y is None or from_y[1] != y.b:
        return False
    return (from_y[0] - y.frame_a) * (from_y[2] - y.frame_b) < 0


def anchored_squares(
    squares: Float[np.ndarray, "N S"],
    points: Sequence[AnchorPoint],
    *,
    matched_square: float,
    nat: float,
    fps_to: float,
    per_frame: int = 1,
) -> Float[np.ndarray, "N S"]:
    """Squared distances with the penalties of anchors.

    Args:
        matched_square: of matching poses; at an anchor the square is at most this.
        nat: the square that costs one nat (`square_per_nat`).
        fps_to: of the columns' video.
        per_frame: columns per frame of the columns' video.
    """
    if not points:
        return squares
    out = squares.copy()
    positions = np.arange(squares.shape[1]) / per_frame
    for point in points:
        away = np.minimum(np.abs(positions - point.position) / (REACH_S * fps_to), 1.0)
        base = np.fmin(out[point.row], matched_square)
        out[point.row] = base + (HARD_NATS if point.hard else SOFT_NATS) * nat * away**2
    return out


def anchored_distances(
    distances: DistanceMatrix, hints: Hints, fps: Sequence[float], evidence_per_s: float
) -> DistanceMatrix:
    """All pairs of frames compared, with the penalties of all anchors in both directions."""
    if not hints.anchors:
        return distances
    squares = dict(distances.squares)
    for (i, j), block in distances.squares.items():
        for a, b in ((i, j), (j, i)):
            block = anchored_squares(
                block,
                _points_between(hints, a, b),
                matched_square=distances.matched_square,
                nat=square_per_nat(distances.matched_square, fps[a], evidence_per_s),
                fps_to=fps[b],
            ).T
        squares[i, j] = block
    return replace(distances, squares=squares)


def _points_between(hints: Hints, a: int, b: int) -> list[AnchorPoint]:
    """The anchors of video a in video b."""
    points = []
    for anchor in hints.anchors:
        from_a = anchor.from_video(a)
        if from_a is not None and from_a[1] == b:
            points.append(AnchorPoint(from_a[0], from_a[2], anchor.hard))
    return points


def square_per_nat(matched_square: float, fps: float, evidence_per_s: float) -> float:
    """The squared distance that makes a position of one frame one nat less likely."""
    return matched_square / observations_per_frame(evidence_per_s, fps)


def led_through(
    positions: Float[np.ndarray, " T"],
    confidence: Float[np.ndarray, " T"],
    points: Sequence[tuple[int, float]],
) -> tuple[Float[np.ndarray, " T"], Float[np.ndarray, " T"]]:
    """A non-decreasing map led exactly through points (frame, position); confidence 1 there.

    Frames before a point lie at or before it, frames after it at or after: those that the evidence
    places on the wrong side move onto the point.
    """
    out, trusted = positions.copy(), confidence.copy()
    for frame, position in points:
        out[:frame] = np.minimum(out[:frame], position)
        out[frame + 1 :] = np.maximum(out[frame + 1 :], position)
    for frame, position in points:
        out[frame], trusted[frame] = position, 1.0
    return out, trusted
