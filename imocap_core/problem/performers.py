"""Between detections and the core's people: who is followed in each video, and who performs.

The user's word counts first, then the score (presence x size x motion); where somebody else scores
nearly as well, what the people of the other videos do decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imocap_core.body.layouts import layout_names
from imocap_core.io.video import read_rgb
from imocap_core.lifter.infer import lift
from imocap_core.lifter.points import can_lift, to_common
from imocap_core.lifter.weights import load_lifter
from imocap_core.params import KeypointsParams
from imocap_core.people.agreement import rivals, who_performs
from imocap_core.people.appearance import Looks, exchange_where_met, join_by_looks, look_of
from imocap_core.people.named import Place, named_performer, track_at, track_numbered
from imocap_core.people.sides import exchanged, limbs_of, repaired
from imocap_core.people.tracking import Performer, Track, performer_of, rank, ranked_tracks
from imocap_core.pipeline.person import Person

Array = NDArray[np.float64]
LOOK_S = 0.2  # people's clothes are looked at this often
LEAST_SIZE_PX = 1.0
EXCHANGES = ("mediapipe33",)  # of a detector that takes backs for fronts in single frames
NOBODY = 0.03  # of the best score: who has less is a false detection or far away


@dataclass(frozen=True)
class Watched:
    """One video: everybody found in its used frames, who was followed, and with what scores."""

    id: str
    people: list[Array]  # (P, K, 3) a frame
    frames: NDArray[np.int64]
    size: tuple[int, int]
    fps: float
    layout: str
    focal_px: float
    ranked: list[tuple[float, Track]]
    person: Person | None = None


def followed(watched: Watched, video: Path | None, params: KeypointsParams) -> Watched:
    """With everybody followed: by motion and, where there are pictures, by looks."""
    ranked = ranked_tracks(
        watched.people,
        watched.size,
        watched.fps,
        min_confidence=params.min_confidence,
        max_gap_s=params.max_gap_s,
    )
    if video is not None and params.looks and _worth_a_look(ranked):
        tracks = [track for _, track in ranked]
        looks = _looks_of(video, watched, tracks)
        tracks, looks = exchange_where_met(tracks, looks)
        tracks, _ = join_by_looks(tracks, looks)
        ranked = rank(tracks, len(watched.people), watched.size)
    return replace(watched, ranked=ranked)


def _worth_a_look(ranked: Sequence[tuple[float, Track]]) -> bool:
    """Whether anybody else counts for enough that a mistake about who is who would matter."""
    return len(ranked) > 1 and ranked[1][0] > NOBODY * ranked[0][0]


def performers(watched: Sequence[Watched], file: Path, params: KeypointsParams) -> list[Performer]:
    """The performer of every video. ValueError when somebody is named who is not there."""
    named = [_named(w, file) for w in watched]
    rows = [0 if row is None else row for row in named]
    told = ["" for _ in watched]
    if params.performer == "agreement":
        rows, told = _by_agreement(watched, named)
    return [
        _sides(w, _performer(w, row, row if n is not None else None, said), params)
        for w, row, n, said in zip(watched, rows, named, told, strict=True)
    ]


def _performer(watched: Watched, row: int, named: int | None, said: str) -> Performer:
    if named is not None:
        return named_performer(watched.ranked, row, watched.people)
    found = performer_of(watched.ranked, row, watched.people)
    return replace(found, note=found.note + said) if said else found


def _named(watched: Watched, file: Path) -> int | None:
    """Row of the track that action.yaml names; None when it names nobody."""
    person = watched.person
    if person is None:
        return None
    try:
        if person.track is not None:
            return track_numbered(watched.ranked, person.track)
        frame = int(person.frame or 0) - int(watched.frames[0])
        return track_at(watched.ranked, Place(frame, person.at, person.box))
    except ValueError as error:
        raise ValueError(
            f"{file}: videos.{watched.id}.person: {error} (boxes x0 y0 x1 y1 in pixels; "
            f"`imocap people` lists everybody)"
        ) from None


def _by_agreement(
    watched: Sequence[Watched], named: Sequence[int | None]
) -> tuple[list[int], list[str]]:
    """Rows of the performers, and what is to be said where agreement overruled the score."""
    ways = [
        [row] if row is not None else rivals([score for score, _ in w.ranked]) or [0]
        for w, row in zip(watched, named, strict=True)
    ]
    rows, told = [own[0] for own in ways], ["" for _ in watched]
    asked = [v for v, w in enumerate(watched) if w.ranked and can_lift(w.layout)]
    if len(asked) < 2 or all(len(ways[v]) == 1 for v in asked):
        return rows, told
    poses = [[_lifted(watched[v], row) for row in ways[v]] for v in asked]
    scores = [[watched[v].ranked[row][0] for row in ways[v]] for v in asked]
    for v, choice in zip(asked, who_performs(scores, poses), strict=True):
        rows[v] = ways[v][choice]
        if choice:
            told[v] = (
                f"; track {rows[v] + 1} was taken, not track 1: what it does is what the other "
                "videos show (`person` in action.yaml says otherwise)"
            )
    return rows, told


def _lifted(watched: Watched, row: int) -> Array:
    """3D joints (T, 24, 3) of a track where it is seen; any axes do."""
    track = watched.ranked[row][1]
    poses = np.full((track.frames[-1] - track.frames[0] + 1, *track.poses[0].shape), np.nan)
    poses[np.array(track.frames) - track.frames[0]] = np.stack(track.poses)
    rays = (poses[..., :2] - 0.5 * np.array(watched.size)) / watched.focal_px
    points, trust = to_common(rays, np.nan_to_num(poses[..., 2]), watched.layout)
    found = lift(load_lifter(), points, trust, watched.fps)
    return found.joints[found.seen]


def _sides(watched: Watched, found: Performer, params: KeypointsParams) -> Performer:
    """With exchanged sides put back, and a word about it."""
    repairs = params.sides == "repair" or (params.sides == "auto" and watched.layout in EXCHANGES)
    if not repairs or found.tracks_found == 0:
        return found
    xy, trust, count = found.xy_px, found.confidence, 0
    boxes = found.box_px[:, 2:] - found.box_px[:, :2]
    size = np.maximum(np.nan_to_num(np.hypot(*boxes.T), nan=0.0), LEAST_SIZE_PX)
    size = np.maximum(size, float(np.median(size)))
    for pairs in limbs_of(layout_names(watched.layout)):
        frames = exchanged(xy, size, pairs, watched.fps)
        xy, trust = repaired(xy, trust, frames, pairs)
        count += int(frames.sum())
    said = f"; left and right of a limb put back in {count} frames" if count else ""
    return replace(found, xy_px=xy, confidence=trust, note=found.note + said)


def _looks_of(video: Path, watched: Watched, tracks: Sequence[Track]) -> list[Looks]:
    """The clothes of everybody followed, every `LOOK_S`."""
    step = max(1, round(LOOK_S * watched.fps))
    first, last = int(watched.frames[0]), int(watched.frames[-1])
    looks: list[dict[int, Array]] = [{} for _ in tracks]
    at = [dict(zip(track.frames, track.poses, strict=True)) for track in tracks]
    for number, picture in read_rgb(video, first, last + 1):
        frame = number - first
        if frame % step == 0:
            for own, poses in zip(looks, at, strict=True):
                if frame in poses:
                    own[frame] = look_of(picture, poses[frame])
    return list(looks)
