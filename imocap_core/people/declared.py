"""The performer that action.yaml declares: by a track's number, or by a place in some frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from imocap_core.people.performer import PerformerKeypoints, RankedTracks, performer_of
from imocap_core.people.tracking import PersonTrack, box_of, size_of_box

MAX_DISTANCE = 0.5  # of a point from a person's box, in units of the box's diagonal


@dataclass(frozen=True)
class FramePlace:
    """A point or a box (x0, y0, x1, y1) in one frame, an index among the used frames."""

    frame: int
    point_px: tuple[float, float] | None = None
    box_px: tuple[float, float, float, float] | None = None


def row_of_number(ranked: RankedTracks, number: int) -> int:
    """Row of the track with a number, 1 for the best score.

    ValueError states how many there are.
    """
    if not 1 <= number <= len(ranked):
        raise ValueError(f"track: expected 1 to {len(ranked)}, got {number}")
    return number - 1


def row_at_place(ranked: RankedTracks, place: FramePlace) -> int:
    """Row of the track that is nearest to a place in its frame.

    A point must lie in the box around the person or within half its diagonal of it; a box must
    overlap it. ValueError lists who is in that frame.
    """
    distances = [_distance(_box_in(track, place.frame), place) for _, track in ranked]
    near = [
        (distance, row)
        for row, distance in enumerate(distances)
        if distance is not None and distance < MAX_DISTANCE
    ]
    if not near:
        present = [
            f"track {row + 1} at ({', '.join(f'{v:.0f}' for v in box)})"
            for row, (_, track) in enumerate(ranked)
            if (box := _box_in(track, place.frame)) is not None
        ]
        where = place.box_px if place.point_px is None else place.point_px
        declared = ", ".join(f"{v:g}" for v in where or ())
        raise ValueError(
            f"expected a person at ({declared}), got nobody; in that frame there are: "
            f"{'; '.join(present) or 'none'}"
        )
    return min(near)[1]


def declared_performer(
    ranked: RankedTracks, row: int, people: Sequence[Float[np.ndarray, "_ K 3"]]
) -> PerformerKeypoints:
    """The keypoints of the declared track, with a note that names the declaration."""
    performer = performer_of(ranked, row, people)
    note = (
        f"{len(ranked)} people followed; track {row + 1} is the performer as action.yaml declares, "
        f"seen in {round(performer.presence * len(people))} of {len(people)} frames"
    )
    return replace(performer, note=note)


def _box_in(track: PersonTrack, frame: int) -> Float[np.ndarray, "4"] | None:
    """The person's box in a frame, None where the person is not tracked."""
    return box_of(track.poses[track.frames.index(frame)]) if frame in track.frames else None


def _distance(box: Float[np.ndarray, "4"] | None, place: FramePlace) -> float | None:
    """Distance of a place from a person's box, in units of the box's diagonal.

    Of points inside: a tenth of the distance from the box's centre. Of a box: 0.5 minus half the
    overlap (intersection over union).
    """
    if box is None:
        return None
    if place.box_px is not None:
        other = np.array(place.box_px)
        inside = np.prod(np.clip(np.minimum(box, other)[2:] - np.maximum(box, other)[:2], 0, None))
        union = np.prod(box[2:] - box[:2]) + np.prod(other[2:] - other[:2]) - inside
        return MAX_DISTANCE - 0.5 * float(inside / max(union, 1e-9))
    point = np.array(place.point_px)
    outside = np.maximum(np.maximum(box[:2] - point, point - box[2:]), 0)
    centre = 0.5 * (box[:2] + box[2:])
    return float(np.hypot(*outside) + 0.1 * np.hypot(*(point - centre))) / size_of_box(box)
