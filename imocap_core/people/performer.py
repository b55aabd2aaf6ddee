"""The performer of a video: the track with the largest presence x size x motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from imocap_core.people.tracking import (
    PersonTrack,
    box_of,
    distinct_people,
    follow,
    join_tracks,
    size_of,
)

STILL = 0.2  # of the size: the motion score of a person who does not move


RankedTracks = Sequence[tuple[float, PersonTrack]]
"""Tracks with their scores, the largest first."""


@dataclass(frozen=True)
class PerformerKeypoints:
    """The keypoints of the chosen person in every frame of a video.

    Frames in which the person was not tracked are NaN with confidence 0. ``tracks_found``: how many
    people were tracked; ``presence``: share of the frames in which the person was tracked.
    """

    xy_px: Float[np.ndarray, "T K 2"]
    confidence: Float[np.ndarray, "T K"]
    box_px: Float[np.ndarray, "T 4"]
    tracks_found: int
    presence: float
    note: str


def without_frames(
    performer: PerformerKeypoints, out: Bool[np.ndarray, " T"]
) -> PerformerKeypoints:
    """The performer's keypoints with those of some frames missing."""
    return replace(
        performer,
        xy_px=np.where(out[:, None, None], np.nan, performer.xy_px),
        confidence=np.where(out[:, None], 0.0, performer.confidence),
        box_px=np.where(out[:, None], np.nan, performer.box_px),
    )


def ranked_tracks(
    people: Sequence[Float[np.ndarray, "_ K 3"]],
    size: tuple[int, int],
    fps: float,
    *,
    min_confidence: float,
    max_gap_s: float = 1.0,
) -> list[tuple[float, PersonTrack]]:
    """Everybody's tracks with their scores, the largest first.

    A score is the product of presence, size in the picture, and motion.

    Args:
        people: per frame, the poses (P, K, 3) of everybody detected: x, y, confidence.
        size: (width, height) of the picture.
        min_confidence: joints below it are missing.
        max_gap_s: tracks may be interrupted for so long. Tracks that end and begin again where the
            person is predicted are joined if the gap is at most five times as long.
    """
    cleaned = [distinct_people(frame, min_confidence) for frame in people]
    max_gap = max(1, round(max_gap_s * fps))
    tracks = join_tracks(follow(cleaned, max_gap), 5 * max_gap)
    # a person of a few frames is a false detection: it is tracked but not counted
    counted = [t for t in tracks if len(t.frames) >= min(5, len(people))]
    return rank(counted, len(people), size)


def rank(
    tracks: Sequence[PersonTrack], frames: int, size: tuple[int, int]
) -> list[tuple[float, PersonTrack]]:
    """Tracks with their scores in a video of so many frames, the largest first."""
    scores = np.array([_score(track, frames, size) for track in tracks])
    order = np.argsort(-scores, kind="stable")
    return [(float(scores[k]), tracks[k]) for k in order]


def performer_of(
    ranked: RankedTracks, chosen: int, people: Sequence[Float[np.ndarray, "_ K 3"]]
) -> PerformerKeypoints:
    """The keypoints of one of the tracks, frame by frame."""
    keypoints = people[0].shape[1] if people else 0
    xy = np.full((len(people), keypoints, 2), np.nan)
    confidence = np.zeros((len(people), keypoints))
    box = np.full((len(people), 4), np.nan)
    if not ranked:
        nobody = "nobody was found in this video"
        return PerformerKeypoints(xy, confidence, box, 0, 0.0, nobody)
    best = ranked[chosen][1]
    for frame, pose in zip(best.frames, best.poses, strict=True):
        xy[frame], confidence[frame], box[frame] = pose[:, :2], pose[:, 2], box_of(pose)
    presence = len(best.frames) / len(people)
    scores = np.array([score for score, _ in ranked])
    note = _note(best, people, scores)
    return PerformerKeypoints(xy, confidence, box, len(ranked), presence, note)


def _score(track: PersonTrack, frames: int, size: tuple[int, int]) -> float:
    """Presence x size x motion; motion is how far the joints spread over time, in body sizes."""
    poses = np.stack(track.poses)
    person_size = float(np.median([size_of(pose) for pose in track.poses]))
    positions = poses[:, (poses[..., 2] > 0).any(axis=0), :2]  # of joints that were ever detected
    spread = np.nanmean(np.linalg.norm(positions - np.nanmedian(positions, axis=0), axis=-1))
    share = person_size / float(np.hypot(*size))
    return len(track.frames) / frames * share * (STILL + float(spread / person_size))


def _note(best: PersonTrack, people: Sequence[np.ndarray], scores: Float[np.ndarray, " N"]) -> str:
    presence = f"the performer is seen in {len(best.frames)} of {len(people)} frames"
    if len(scores) == 1:
        return f"1 person followed; {presence}"
    ratio = f"scores {scores[0] / scores[1]:.1f} times the next"
    return f"{len(scores)} people followed; {presence} and {ratio} (presence x size x motion)"
