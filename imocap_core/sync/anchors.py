"""What the user knows: frames that show the same moment, and spans that match nothing.

An anchor ties frame t of one video to frame s of another. It bends the squared distances that
every warp is read from: a soft one as strong evidence among the rest, a hard one as strong as
evidence may be, and in the end the map is led through it exactly.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from imocap_core.sync.pairwise.distance_matrix import Comparison

Array = NDArray[np.float64]

SOFT_NATS, HARD_NATS = 10.0, 60.0  # how much less likely than the anchor any far position is
REACH_S = 0.15  # at this distance from the anchor a position is `nats` less likely


@dataclass(frozen=True)
class Anchor:
    """Frame `frame_a` of video `a` shows the moment of frame `frame_b` of video `b`; videos and
    frames by index, `frame_b` may be fractional."""

    a: int
    frame_a: int
    b: int
    frame_b: float
    hard: bool = False

    def seen_from(self, video: int) -> tuple[int, int, float] | None:
        """The own frame, the other video and its frame; None where the video has no part."""
        if video == self.a:
            return self.frame_a, self.b, self.frame_b
        if video == self.b:
            return round(self.frame_b), self.a, float(self.frame_a)
        return None


@dataclass(frozen=True)
class Hints:
    """All that the user says; `forbidden` (video, first frame, one past the last)."""

    anchors: tuple[Anchor, ...] = ()
    forbidden: tuple[tuple[int, int, int], ...] = ()

    def forbids(self, lengths: Sequence[int]) -> list[NDArray[np.bool_]]:
        """Per video (T_v,): the frames that match nothing."""
        out = [np.zeros(n, dtype=bool) for n in lengths]
        for video, first, stop in self.forbidden:
            out[video][first:stop] = True
        return out

    def among(self, videos: Sequence[int]) -> "Hints":
        """The hints that concern these videos alone, renumbered in their order."""
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
    """ValueError that names every hint of a video or frame that isn't there, and every two anchors
    that cross each other in time."""
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
    seen = x.seen_from(y.a)
    if seen is None or seen[1] != y.b:
        return False
    return (seen[0] - y.frame_a) * (seen[2] - y.frame_b) < 0


def bent(
    squares: Array,
    ties: Sequence[tuple[int, float, bool]],
    *,
    near: float,
    unit: float,
    fps_to: float,
    per_frame: int = 1,
) -> Array:
    """Squared distances (n, S) with what the user says: ties (row, frame of the columns' video,
    hard).

    `near`: the square of matching poses, which the anchor's own never exceeds; `unit`: the square
    that costs one nat; `per_frame` columns make a frame of the columns' video.
    """
    if not ties:
        return squares
    out = squares.copy()
    at = np.arange(squares.shape[1]) / per_frame
    for row, frame, hard in ties:
        away = np.minimum(np.abs(at - frame) / (REACH_S * fps_to), 1.0)
        base = np.fmin(out[row], near)
        out[row] = base + (HARD_NATS if hard else SOFT_NATS) * unit * away**2
    return out


def bent_comparison(
    c: Comparison, hints: Hints, fps: Sequence[float], evidence_per_s: float
) -> Comparison:
    """All pairs of frames compared, with what the anchors say; symmetric as it was."""
    if not hints.anchors:
        return c
    squares = c.squares.copy()
    for i, j in c.blocks.pairs():
        block = np.asarray(c.blocks.block(squares, i, j))
        for a, b in ((i, j), (j, i)):
            ties = [
                (seen[0], seen[2], x.hard)
                for x in hints.anchors
                if (seen := x.seen_from(a)) is not None and seen[1] == b
            ]
            unit = unit_of(c.near, fps[a], evidence_per_s)
            block = bent(block, ties, near=c.near, unit=unit, fps_to=fps[b]).T
        c.blocks.block(squares, i, j)[...] = block
        c.blocks.block(squares, j, i)[...] = block.T
    return replace(c, squares=squares)


def unit_of(near: float, fps: float, evidence_per_s: float) -> float:
    """The squared distance that makes a position of one frame one nat less likely."""
    return near / min(evidence_per_s / fps, 4.0)


def led_through(
    positions: Array, confidence: Array, ties: Sequence[tuple[int, float]]
) -> tuple[Array, Array]:
    """A non-decreasing map (T,) led exactly through ties (frame, position); confidence 1 there.

    Frames before a tie lie at or before it, frames after it at or after: what evidence put on the
    wrong side moves onto the tie.
    """
    out, trust = positions.copy(), confidence.copy()
    for frame, position in ties:
        out[:frame] = np.minimum(out[:frame], position)
        out[frame + 1 :] = np.maximum(out[frame + 1 :], position)
    for frame, position in ties:
        out[frame], trust[frame] = position, 1.0
    return out, trust
