"""The performer as the user names them: a track's number, or where they are in some frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imocap_core.people.tracking import Performer, Track, performer_of

Array = NDArray[np.float64]
Ranked = Sequence[tuple[float, Track]]


@dataclass(frozen=True)
class Place:
    """A point or box of the picture in a frame of the video (an index among the used frames)."""

    frame: int
    at_px: tuple[float, float] | None = None
    box_px: tuple[float, float, float, float] | None = None  # x0 y0 x1 y1


def track_numbered(ranked: Ranked, number: int) -> int:
    """Row of the track with a number, 1 for the best score.

    ValueError says how many there are.
    """
    if not 1 <= number <= len(ranked):
        raise ValueError(f"track: expected 1 to {len(ranked)}, got {number}")
    return number - 1


def track_at(ranked: Ranked, place: Place) -> int:
    """Row of the track that is nearest to a place in its frame.

    A point must lie in the box around the person (or within half its size of it), a box must
    overlap it. ValueError names who is there.
    """
    found = [_away(_box_in(track, place.frame), place) for _, track in ranked]
    near = [(away, row) for row, away in enumerate(found) if away is not None and away < 0.5]
    if not near:
        there = [
            f"track {row + 1} at ({', '.join(f'{v:.0f}' for v in box)})"
            for row, (_, track) in enumerate(ranked)
            if (box := _box_in(track, place.frame)) is not None
        ]
        where = place.box_px if place.at_px is None else place.at_px
        told = ", ".join(f"{v:g}" for v in where or ())
        raise ValueError(
            f"expected a person at ({told}), got nobody; in that frame there are: "
            f"{'; '.join(there) or 'none'}"
        )
    return min(near)[1]


def named_performer(ranked: Ranked, row: int, people: Sequence[Array]) -> Performer:
    """The performer that was named, and a note that says so."""
    found = performer_of(ranked, row, people)
    seen = round(found.presence * len(people))
    note = (
        f"{len(ranked)} people followed; track {row + 1} is the performer as action.yaml says, "
        f"seen in {seen} of {len(people)} frames"
    )
    return Performer(
        found.xy_px, found.confidence, found.box_px, found.tracks_found, found.presence, note
    )


def box_of(pose: Array) -> Array:
    """x0, y0, x1, y1 around the points (K, 3) with confidence."""
    seen = pose[pose[:, 2] > 0, :2]
    return np.concatenate([seen.min(axis=0), seen.max(axis=0)])


def _box_in(track: Track, frame: int) -> Array | None:
    """The person's box in a frame, None when they are not seen there."""
    return box_of(track.poses[track.frames.index(frame)]) if frame in track.frames else None


def _away(box: Array | None, place: Place) -> float | None:
    """How far from the box a place is, in sizes of it; inside: a little, by how far off its middle.

    For a box: 0.5 less half the overlap (intersection over union).
    """
    if box is None:
        return None
    size = max(1.0, float(np.hypot(*(box[2:] - box[:2]))))
    if place.box_px is not None:
        other = np.array(place.box_px)
        inside = np.prod(np.clip(np.minimum(box, other)[2:] - np.maximum(box, other)[:2], 0, None))
        both = np.prod(box[2:] - box[:2]) + np.prod(other[2:] - other[:2]) - inside
        return 0.5 - 0.5 * float(inside / max(both, 1e-9))
    point = np.array(place.at_px)
    outside = np.maximum(np.maximum(box[:2] - point, point - box[2:]), 0)
    middle = 0.5 * (box[:2] + box[2:])
    return float(np.hypot(*outside) + 0.1 * np.hypot(*(point - middle))) / size
