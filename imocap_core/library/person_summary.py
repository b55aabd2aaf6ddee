"""People tracked in videos, as values."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PersonSummary:
    """One person tracked in a video; action.yaml names it by `number`, or by box and frame.

    first_frame, last_frame: source frames. share: of the used frames in which it is tracked.
    score: by which the performer is chosen, over the best track's. box_px: x0 y0 x1 y1 in
    box_frame, the middle one of the track.
    """

    number: int
    first_frame: int
    last_frame: int
    share: float
    score: float
    box_px: tuple[float, float, float, float]
    box_frame: int


@dataclass(frozen=True)
class VideoPeople:
    """Everybody tracked in one video, best score first, and sentences about it.

    fault: why a run would leave the video out, and what to do; None when it can be used.
    """

    id: str
    tracks: list[PersonSummary]
    notes: list[str]
    fault: str | None = None
