"""The performer of a video: declared, the most present, or the one whom other videos show too.

The performer among several people: whose motion agrees with the people of the other videos. Used
only where a video shows several candidates. Every candidate's 3D poses are compared with those of
the other videos' candidates, independent of time. People who stand still are near each other in all
videos, so it also counts how much nearer the other's poses are than any one of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from jaxtyping import Bool, Float

from imocap_core.conventions import SMPL_JOINTS
from imocap_core.people.tracking import (
    PersonTrack,
    box_of,
    box_overlap,
    distinct_people,
    follow,
    join_tracks,
    size_of,
    size_of_box,
)
from imocap_core.sync.procrustes import procrustes_distances

STILL_SCORE = 0.2  # of the size: the motion score of a person who does not move


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
    return len(track.frames) / frames * share * (STILL_SCORE + float(spread / person_size))


def _note(best: PersonTrack, people: Sequence[np.ndarray], scores: Float[np.ndarray, " N"]) -> str:
    presence = f"the performer is seen in {len(best.frames)} of {len(people)} frames"
    if len(scores) == 1:
        return f"1 person followed; {presence}"
    ratio = f"scores {scores[0] / scores[1]:.1f} times the next"
    return f"{len(scores)} people followed; {presence} and {ratio} (presence x size x motion)"


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
        return MAX_DISTANCE - 0.5 * box_overlap(box, np.array(place.box_px, dtype=np.float64))
    point = np.array(place.point_px)
    outside = np.maximum(np.maximum(box[:2] - point, point - box[2:]), 0)
    centre = 0.5 * (box[:2] + box[2:])
    return float(np.hypot(*outside) + 0.1 * np.hypot(*(point - centre))) / size_of_box(box)


RIVAL_SHARE = 0.4  # of the best score: people with less are not candidates
DISTANCE_SCALE_M = 0.1  # pose distance that outweighs a factor of e in scores
MOTION_WEIGHT = 2.0  # of the log ratio of the distances without and with motion
LEAST_DISTANCE_M = 0.01  # nearer poses are equal
MAX_POSES = 60  # of a candidate
MAX_COMBINATIONS = 4096  # of candidates that are tried exhaustively
COMPARED_JOINTS = [
    k
    for k, name in enumerate(SMPL_JOINTS)
    if any(p in name for p in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle", "head"))
]
LEAST_VISIBILITY = 0.02  # with which a joint that the detector guesses counts


@dataclass(frozen=True)
class SeenMotion:
    """One person's motion in a video, in any axes.

    joints_m: (T, 24, 3). visibility: (T, 24) confidence of the detections that show each joint, 0
    to 1: hidden ones are guessed, otherwise in every video.
    """

    joints_m: Float[np.ndarray, "T 24 3"]
    visibility: Float[np.ndarray, "T 24"]

    def compared(self) -> tuple[Float[np.ndarray, "N J 3"], Float[np.ndarray, "N J"]]:
        """At most `MAX_POSES` poses of the joints that are compared, and their weights."""
        step = max(1, len(self.joints_m) // MAX_POSES)
        weights = np.clip(self.visibility[::step, COMPARED_JOINTS], LEAST_VISIBILITY, 1.0)
        return self.joints_m[::step, COMPARED_JOINTS], weights


def rivals(scores: Sequence[float]) -> list[int]:
    """Rows of the candidates of one video (scores falling): those near the best score."""
    return [row for row, score in enumerate(scores) if score >= RIVAL_SHARE * scores[0]]


def choose_by_agreement(
    scores: Sequence[Sequence[float]], motions: Sequence[Sequence[SeenMotion]]
) -> list[int]:
    """Row of the performer in each video: the combination of candidates that agrees best.

    Args:
        scores: per video, of its candidates (presence x size x motion), positive.
        motions: per video and candidate.

    Returns the combination with the largest sum of log scores and `likeness` of motions.
    """
    videos = len(scores)
    likenesses = {
        (v, w): np.array([[likeness(a, b) for b in motions[w]] for a in motions[v]])
        for v in range(videos)
        for w in range(v + 1, videos)
    }
    log_scores = [np.log(np.array(s) / max(s)) for s in scores]

    def value(rows: Sequence[int]) -> float:
        alike = [likenesses[v, w][rows[v], rows[w]] for v, w in likenesses]
        mean = float(np.mean(alike)) if alike else 0.0
        total = sum(float(log_scores[v][row]) for v, row in enumerate(rows))
        return total + (videos - 1) * mean

    candidates = [range(len(s)) for s in scores]
    if np.prod([len(c) for c in candidates]) <= MAX_COMBINATIONS:
        combinations: list[Sequence[int]] = list(product(*candidates))
        best = max(combinations, key=value)
        return list(best)
    return _coordinate_ascent([0] * videos, candidates, value)


def likeness(a: SeenMotion, b: SeenMotion) -> float:
    """Agreement of two motions, in units of log scores: small distances, and smaller ones than
    without motion."""
    moving, still = pose_set_distances_m(a, b)
    ratio = max(still, LEAST_DISTANCE_M) / max(moving, LEAST_DISTANCE_M)
    return MOTION_WEIGHT * math.log(ratio) - moving / DISTANCE_SCALE_M


def pose_set_distances_m(a: SeenMotion, b: SeenMotion) -> tuple[float, float]:
    """Symmetric mean distance of each pose to the nearest pose of the other set (Chamfer distance),
    and to the one pose of the other set that is the nearest to all.

    Poses are rigidly aligned first, joints weighed by how well both show them; the order of the
    frames does not matter.
    """
    (poses_a, weights_a), (poses_b, weights_b) = a.compared(), b.compared()
    distance = procrustes_distances(poses_a, poses_b, weights_a, weights_b)
    moving = 0.5 * (distance.min(1).mean() + distance.min(0).mean())
    still = 0.5 * (distance.mean(0).min() + distance.mean(1).min())
    return float(moving), float(still)


def _coordinate_ascent(
    rows: list[int], candidates: Sequence[range], value: Callable[[Sequence[int]], float]
) -> list[int]:
    """Each video's best choice given the others', until none changes."""
    while True:
        before = list(rows)
        for v, choices in enumerate(candidates):
            others = list(rows)
            rows[v] = max(choices, key=lambda row: value([*others[:v], row, *others[v + 1 :]]))
        if rows == before:
            return rows
