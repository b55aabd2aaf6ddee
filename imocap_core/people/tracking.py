"""Who is who: people followed through the frames as tracks, and the performer chosen.

Distances between poses are in units of the person's own size, so one gate fits near and far people.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

Array = NDArray[np.float64]

MIN_JOINTS = 4  # fewer found joints are no person
DUPLICATE = 0.08  # two poses nearer than this share of their size are one person seen twice
GATE = 0.35  # a step between frames is at most this share of the size,
GATE_PER_GAP_FRAME = 0.03  # and more for each frame in which the person was not seen
MAX_REJOIN_GATE = 1.5
STILL = 0.2  # of the size: how much motion is worth as much as none


@dataclass(frozen=True)
class Performer:
    """The chosen person: ``xy_px`` (T, K, 2), ``confidence`` (T, K), ``box_px`` (T, 4).

    Frames in which nobody was followed are NaN with confidence 0. ``presence`` is the share of
    frames in which the person was found.
    """

    xy_px: Array
    confidence: Array
    box_px: Array
    tracks_found: int
    presence: float
    note: str


@dataclass
class Track:
    """Frame numbers of one person and the pose (K, 3) in each."""

    frames: list[int] = field(default_factory=list)
    poses: list[Array] = field(default_factory=list)

    def add(self, frame: int, pose: Array) -> None:
        self.frames.append(frame)
        self.poses.append(pose)


def choose_performer(
    people: Sequence[Array],
    size: tuple[int, int],
    fps: float,
    *,
    min_confidence: float,
    max_gap_s: float = 1.0,
) -> Performer:
    """Follow everyone in ``people`` (one array (P, K, 3) of x, y, confidence a frame).

    ``size`` (width, height) of the picture. The performer is the track with the largest product of
    presence, size in the picture, and motion. Tracks that break for at most ``max_gap_s`` go on;
    those that end and begin again where the person would be are joined, if the gap is no longer
    than five times that.
    """
    ranked = ranked_tracks(people, size, fps, min_confidence=min_confidence, max_gap_s=max_gap_s)
    return performer_of(ranked, 0, people)


def ranked_tracks(
    people: Sequence[Array],
    size: tuple[int, int],
    fps: float,
    *,
    min_confidence: float,
    max_gap_s: float = 1.0,
) -> list[tuple[float, Track]]:
    """Everybody who was followed, with their scores, the largest first (see `choose_performer`)."""
    cleaned = [distinct_people(frame, min_confidence) for frame in people]
    max_gap = max(1, round(max_gap_s * fps))
    tracks = join_tracks(follow(cleaned, max_gap), 5 * max_gap)
    # a person of a few frames is a false detection: it is followed but not counted
    counted = [t for t in tracks if len(t.frames) >= min(5, len(people))]
    return rank(counted, len(people), size)


def rank(tracks: Sequence[Track], frames: int, size: tuple[int, int]) -> list[tuple[float, Track]]:
    """Tracks with their scores in a video of so many frames, the largest first."""
    scores = np.array([_score(track, frames, size) for track in tracks])
    order = np.argsort(-scores, kind="stable")
    return [(float(scores[k]), tracks[k]) for k in order]


def performer_of(
    ranked: Sequence[tuple[float, Track]], chosen: int, people: Sequence[Array]
) -> Performer:
    """One of those who were followed, frame by frame."""
    keypoints = people[0].shape[1] if people else 0
    xy = np.full((len(people), keypoints, 2), np.nan)
    confidence = np.zeros((len(people), keypoints))
    box = np.full((len(people), 4), np.nan)
    if not ranked:
        return Performer(xy, confidence, box, 0, 0.0, "nobody was found in this video")
    best = ranked[chosen][1]
    for frame, pose in zip(best.frames, best.poses, strict=True):
        xy[frame], confidence[frame], box[frame] = pose[:, :2], pose[:, 2], _box(pose)
    presence = len(best.frames) / len(people)
    scores = np.array([score for score, _ in ranked])
    return Performer(xy, confidence, box, len(ranked), presence, _note(best, people, scores))


def distinct_people(frame: Array, min_confidence: float) -> Array:
    """People (P', K, 3) of one frame: weak points missing, too few points and doubles left out.

    Of two people in the same place the one with the larger sum of confidences stays.
    """
    frame = np.array(frame, dtype=np.float64)
    weak = ~(frame[..., 2] >= min_confidence) | ~np.isfinite(frame).all(-1) | (frame[..., 2] <= 0)
    frame[weak] = (np.nan, np.nan, 0.0)
    frame = frame[(frame[..., 2] > 0).sum(axis=1) >= MIN_JOINTS]
    kept: list[Array] = []
    for i in np.argsort(-frame[..., 2].sum(axis=1), kind="stable"):
        if all(pose_distance(frame[i], other) > DUPLICATE for other in kept):
            kept.append(frame[i])
    return np.stack(kept) if kept else frame[:0]


def pose_distance(a: Array, b: Array) -> float:
    """Median distance of the joints both poses (K, 3) have, in units of their mean size.

    Poses that share fewer than three joints are compared by the middles of their boxes.
    """
    scale = 0.5 * (_size(a) + _size(b))
    both = (a[:, 2] > 0) & (b[:, 2] > 0)
    if both.sum() >= 3:
        return float(np.median(np.linalg.norm(a[both, :2] - b[both, :2], axis=1))) / scale
    middles = [0.5 * (box[:2] + box[2:]) for box in (_box(a), _box(b))]
    return float(np.linalg.norm(middles[0] - middles[1])) / scale


def follow(people: Sequence[Array], max_gap: int) -> list[Track]:
    """Tracks by assigning each frame's people to predicted poses (Hungarian method).

    A track that is not seen for more than ``max_gap`` frames has ended.
    """
    tracks: list[Track] = []
    for frame, found in enumerate(people):
        alive = [t for t in tracks if frame - t.frames[-1] <= max_gap]
        found, taken = merge_parts(found, _assign(alive, found, frame), alive, frame)
        for person, pose in enumerate(found):
            if person in taken:
                alive[taken[person]].add(frame, pose)
            else:
                started = Track()
                started.add(frame, pose)
                tracks.append(started)
    return tracks


def merge_parts(
    found: Array, taken: dict[int, int], tracks: Sequence[Track], frame: int
) -> tuple[Array, dict[int, int]]:
    """People and assignments of a frame, with bodies that the detector cut in two made whole.

    A person nobody claims is the rest of a claimed one if both share (almost) no joint and it lies
    where that one's track expects these joints.
    """
    found, rest = found.copy(), set()
    for part in (i for i in range(len(found)) if i not in taken):
        for person, k in taken.items():
            shared = (found[part][:, 2] > 0) & (found[person][:, 2] > 0)
            expected = _predict(tracks[k], frame)
            known = (found[part][:, 2] > 0) & (expected[:, 2] > 0)
            if shared.sum() <= 2 and known.sum() >= 3:
                offset = np.linalg.norm(found[part][known, :2] - expected[known, :2], axis=1)
                if np.median(offset) < GATE * _size(expected):
                    missing = found[person][:, 2] <= 0
                    found[person][missing] = found[part][missing]
                    rest.add(part)
                    break
    kept = [i for i in range(len(found)) if i not in rest]
    return found[kept], {kept.index(person): k for person, k in taken.items()}


def join_tracks(tracks: list[Track], max_gap: int) -> list[Track]:
    """Tracks joined end to begin where a person leaves and comes back, nearest pairs first."""
    tracks = list(tracks)
    while True:
        best: tuple[float, int, int] | None = None
        for i, before in enumerate(tracks):
            for k, after in enumerate(tracks):
                gap = after.frames[0] - before.frames[-1]
                if i == k or not 0 < gap <= max_gap:
                    continue
                distance = pose_distance(_predict(before, after.frames[0]), after.poses[0])
                alike = 0.5 < _size(before.poses[-1]) / _size(after.poses[0]) < 2.0
                if alike and distance < _gate(gap) and (best is None or distance < best[0]):
                    best = (distance, i, k)
        if best is None:
            return tracks
        _, i, k = best
        joined = Track(tracks[i].frames + tracks[k].frames, tracks[i].poses + tracks[k].poses)
        tracks = [t for n, t in enumerate(tracks) if n not in (i, k)] + [joined]


def _assign(tracks: list[Track], found: Array, frame: int) -> dict[int, int]:
    """Person index -> track index, for the pairs within the gate."""
    if not tracks or not len(found):
        return {}
    forbidden = 1e6
    cost = np.full((len(found), len(tracks)), forbidden)
    for k, track in enumerate(tracks):
        predicted, gate = _predict(track, frame), _gate(frame - track.frames[-1])
        for i, pose in enumerate(found):
            distance = pose_distance(predicted, pose)
            if distance < gate:
                cost[i, k] = distance
    rows, columns = linear_sum_assignment(cost)
    return {int(i): int(k) for i, k in zip(rows, columns, strict=True) if cost[i, k] < forbidden}


def _gate(gap: int) -> float:
    return min(GATE + GATE_PER_GAP_FRAME * (gap - 1), MAX_REJOIN_GATE)


def _predict(track: Track, frame: int) -> Array:
    """The last pose moved on with the person's speed over its last frames, for five at most."""
    last = track.poses[-1]
    recent = range(max(0, len(track.frames) - 4), len(track.frames))
    first = track.poses[recent[0]]
    both = (first[:, 2] > 0) & (last[:, 2] > 0)
    elapsed = track.frames[-1] - track.frames[recent[0]]
    if elapsed == 0 or both.sum() < 3:
        return last
    speed = np.median(last[both, :2] - first[both, :2], axis=0) / elapsed
    moved = last.copy()
    moved[:, :2] += speed * min(frame - track.frames[-1], 5)
    return moved


def _box(pose: Array) -> Array:
    """x0, y0, x1, y1 around the found joints."""
    seen = pose[pose[:, 2] > 0, :2]
    return np.concatenate([seen.min(axis=0), seen.max(axis=0)])


def _size(pose: Array) -> float:
    """Diagonal of the box in pixels, at least 1."""
    box = _box(pose)
    return max(1.0, float(np.hypot(box[2] - box[0], box[3] - box[1])))


def _score(track: Track, frames: int, size: tuple[int, int]) -> float:
    """Presence x size x motion; motion is how far the joints spread over time, in body sizes."""
    poses = np.stack(track.poses)
    own_size = float(np.median([_size(pose) for pose in track.poses]))
    middle = np.nanmedian(_filled(poses), axis=0)
    spread = np.nanmean(np.linalg.norm(_filled(poses) - middle, axis=-1)) / own_size
    share = own_size / float(np.hypot(*size))
    return len(track.frames) / frames * share * (STILL + float(spread))


def _filled(poses: Array) -> Array:
    """Positions (T, K, 2) of the joints that were ever found."""
    return poses[:, (poses[..., 2] > 0).any(axis=0), :2]


def _note(best: Track, people: Sequence[Array], scores: Array) -> str:
    seen = f"the performer is seen in {len(best.frames)} of {len(people)} frames"
    if len(scores) == 1:
        return f"1 person followed; {seen}"
    ratio = scores[0] / scores[1]
    sure = f"scores {ratio:.1f} times the next"
    return f"{len(scores)} people followed; {seen} and {sure} (presence x size x motion)"
