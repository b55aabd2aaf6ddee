"""Multi-person 2D tracking by detection.

Distances between poses are in units of the person's size, so one gate fits near and far people.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import median_filter
from scipy.optimize import linear_sum_assignment

MIN_JOINTS = 4  # a detection with fewer joints is not a person
DUPLICATE = 0.08  # two poses nearer than this share of their size are one person detected twice
GATE = 0.35  # a step between frames is at most this share of the size,
GATE_PER_GAP_FRAME = 0.03  # and more for each frame in which the person was not detected
MAX_REJOIN_GATE = 1.5
SAME_PLACE = 0.4  # intersection over union of a box with that of a person who was there
SHORTLY = 5  # frames before, at most
ESTABLISHED = 8  # detections of a track that goes before newer ones
FORBIDDEN = 1e6  # cost of a pair beyond its gate


@dataclass
class PersonTrack:
    """One person's frame indices, and in each the pose (K, 3): x, y in pixels, confidence."""

    frames: list[int] = field(default_factory=list)
    poses: list[Float[np.ndarray, "K 3"]] = field(default_factory=list)

    def add(self, frame: int, pose: Float[np.ndarray, "K 3"]) -> None:
        self.frames.append(frame)
        self.poses.append(pose)


def distinct_people(
    frame: Float[np.ndarray, "_ K 3"], min_confidence: float
) -> Float[np.ndarray, "_ K 3"]:
    """The people of one frame without weak points, false detections and duplicates.

    Of two people in the same place the one with the larger sum of confidences stays.
    """
    frame = np.array(frame, dtype=np.float64)
    weak = ~(frame[..., 2] >= min_confidence) | ~np.isfinite(frame).all(-1) | (frame[..., 2] <= 0)
    frame[weak] = (np.nan, np.nan, 0.0)
    frame = frame[(frame[..., 2] > 0).sum(axis=1) >= MIN_JOINTS]
    distinct: list[np.ndarray] = []
    for i in np.argsort(-frame[..., 2].sum(axis=1), kind="stable"):
        if all(pose_distance(frame[i], other) > DUPLICATE for other in distinct):
            distinct.append(frame[i])
    return np.stack(distinct) if distinct else frame[:0]


def pose_distance(a: Float[np.ndarray, "K 3"], b: Float[np.ndarray, "K 3"]) -> float:
    """Median distance of the joints that both poses have, in units of their mean size.

    Poses that share fewer than three joints are compared by the centres of their boxes.
    """
    scale = 0.5 * (size_of(a) + size_of(b))
    both = (a[:, 2] > 0) & (b[:, 2] > 0)
    if both.sum() >= 3:
        return float(np.median(np.linalg.norm(a[both, :2] - b[both, :2], axis=1))) / scale
    centres = [0.5 * (box[:2] + box[2:]) for box in (box_of(a), box_of(b))]
    return float(np.linalg.norm(centres[0] - centres[1])) / scale


def follow(people: Sequence[Float[np.ndarray, "_ K 3"]], max_gap: int) -> list[PersonTrack]:
    """Tracks by assigning each frame's people to predicted poses (Hungarian method).

    A track without a detection for more than ``max_gap`` frames, or for more frames than it has
    detections, has ended: what a detector reports now and then is nobody who waits out of sight.
    """
    tracks: list[PersonTrack] = []
    for frame, detected in enumerate(people):
        active = [t for t in tracks if frame - t.frames[-1] <= min(max_gap, len(t.frames))]
        assigned = _assign_in_order(active, detected, frame)
        whole, assigned = merge_parts(detected, assigned, active, frame)
        assigned |= _in_the_same_place(active, whole, assigned, frame)
        for person, pose in enumerate(whole):
            if person in assigned:
                active[assigned[person]].add(frame, pose)
            else:
                started = PersonTrack()
                started.add(frame, pose)
                tracks.append(started)
    return tracks


def merge_parts(
    people: Float[np.ndarray, "_ K 3"],
    assigned: dict[int, int],
    tracks: Sequence[PersonTrack],
    frame: int,
) -> tuple[Float[np.ndarray, "_ K 3"], dict[int, int]]:
    """People of a frame and their tracks, with bodies that the detector split in two merged.

    An unassigned person is the rest of an assigned one if both share (almost) no joint and it lies
    where that one's track predicts these joints.
    """
    people, merged = people.copy(), set()
    for part in (i for i in range(len(people)) if i not in assigned):
        for person, k in assigned.items():
            shared = (people[part][:, 2] > 0) & (people[person][:, 2] > 0)
            expected = _predict(tracks[k], frame)
            both = (people[part][:, 2] > 0) & (expected[:, 2] > 0)
            if shared.sum() <= 2 and both.sum() >= 3:
                offset = np.linalg.norm(people[part][both, :2] - expected[both, :2], axis=1)
                if np.median(offset) < GATE * size_of(expected):
                    missing = people[person][:, 2] <= 0
                    people[person][missing] = people[part][missing]
                    merged.add(part)
                    break
    remaining = [i for i in range(len(people)) if i not in merged]
    return people[remaining], {remaining.index(person): k for person, k in assigned.items()}


def join_tracks(tracks: Sequence[PersonTrack], max_gap: int) -> list[PersonTrack]:
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
                alike = 0.5 < size_of(before.poses[-1]) / size_of(after.poses[0]) < 2.0
                if alike and distance < _gate(gap) and (best is None or distance < best[0]):
                    best = (distance, i, k)
        if best is None:
            return tracks
        _, i, k = best
        joined = PersonTrack(tracks[i].frames + tracks[k].frames, tracks[i].poses + tracks[k].poses)
        tracks = [t for n, t in enumerate(tracks) if n not in (i, k)] + [joined]


def box_of(pose: Float[np.ndarray, "K 3"]) -> Float[np.ndarray, "4"]:
    """Bounding box x0, y0, x1, y1 of the joints with confidence."""
    visible = pose[pose[:, 2] > 0, :2]
    return np.concatenate([visible.min(axis=0), visible.max(axis=0)])


def box_overlap(a: Float[np.ndarray, "4"], b: Float[np.ndarray, "4"]) -> float:
    """Intersection over union of two boxes."""
    inside = float(np.prod(np.clip(np.minimum(a, b)[2:] - np.maximum(a, b)[:2], 0, None)))
    union = float(np.prod(a[2:] - a[:2]) + np.prod(b[2:] - b[:2])) - inside
    return inside / max(union, 1e-9)


def _assign_in_order(
    tracks: Sequence[PersonTrack], people: Float[np.ndarray, "_ K 3"], frame: int
) -> dict[int, int]:
    """Person index -> track index; who is left by the established tracks goes to the newer ones.

    A second detection of somebody so takes nobody over (matching cascade: Wojke et al., ICIP 2017).
    """
    assigned: dict[int, int] = {}
    for established in (True, False):
        rows = [k for k, t in enumerate(tracks) if (len(t.frames) >= ESTABLISHED) == established]
        left = [i for i in range(len(people)) if i not in assigned]
        pairs = _assign([tracks[k] for k in rows], people[left], frame)
        assigned |= {left[i]: rows[k] for i, k in pairs.items()}
    return assigned


def _assign(
    tracks: Sequence[PersonTrack], people: Float[np.ndarray, "_ K 3"], frame: int
) -> dict[int, int]:
    """Person index -> track index, for the pairs within the gate.

    Of two tracks in one place the one that was detected last goes on: a gap costs as much distance
    as it widens the gate. A pair is not given up so that two worse ones can be made.
    """
    cost = np.full((len(people), len(tracks)), FORBIDDEN)
    for k, track in enumerate(tracks):
        gap = frame - track.frames[-1]
        predicted, gate = _predict(track, frame), _gate(gap)
        for i, pose in enumerate(people):
            distance = pose_distance(predicted, pose)
            if distance < gate:
                cost[i, k] = distance + gate - GATE
    pairs = _cheapest_pairs(cost, GATE)
    cost[list(pairs)] = FORBIDDEN
    cost[:, list(pairs.values())] = FORBIDDEN
    return pairs | _cheapest_pairs(cost, FORBIDDEN)


def _in_the_same_place(
    tracks: Sequence[PersonTrack],
    people: Float[np.ndarray, "_ K 3"],
    assigned: dict[int, int],
    frame: int,
) -> dict[int, int]:
    """Person index -> track index, of those left over: who fills the box in which an established
    track was a moment ago, whatever the pose. A detector that takes a folded body upside down for
    a frame has all joints elsewhere, but in the same place."""
    waiting = [
        k
        for k, track in enumerate(tracks)
        if k not in assigned.values()
        and len(track.frames) >= ESTABLISHED
        and frame - track.frames[-1] <= SHORTLY
    ]
    left = [i for i in range(len(people)) if i not in assigned]
    cost = np.full((len(left), len(waiting)), FORBIDDEN)
    for row, i in enumerate(left):
        for column, k in enumerate(waiting):
            share = box_overlap(box_of(people[i]), box_of(tracks[k].poses[-1]))
            cost[row, column] = 1 - share if share > SAME_PLACE else FORBIDDEN
    pairs = _cheapest_pairs(cost, FORBIDDEN)
    return {left[row]: waiting[column] for row, column in pairs.items()}


def _cheapest_pairs(cost: Float[np.ndarray, "P N"], unpaired: float) -> dict[int, int]:
    """Row -> column, each at most once, for the least sum; who has no partner costs `unpaired`."""
    rows, columns = linear_sum_assignment(np.minimum(cost, unpaired))
    return {int(i): int(k) for i, k in zip(rows, columns, strict=True) if cost[i, k] < unpaired}


def _gate(gap: int) -> float:
    return min(GATE + GATE_PER_GAP_FRAME * (gap - 1), MAX_REJOIN_GATE)


def _predict(track: PersonTrack, frame: int) -> Float[np.ndarray, "K 3"]:
    """Constant-velocity prediction from the last pose, extrapolated by five frames at most."""
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


def size_of(pose: Float[np.ndarray, "K 3"]) -> float:
    """Diagonal of the pose's box in pixels, at least 1."""
    return size_of_box(box_of(pose))


def size_of_box(box: Float[np.ndarray, "4"]) -> float:
    """Diagonal in pixels, at least 1."""
    return max(1.0, float(np.hypot(box[2] - box[0], box[3] - box[1])))


TRUNK_PER_S = 3.0  # sizes by which the trunk changes in the picture: two turns a second
SUDDEN, AROUND = 3.0, 5  # times the median of so many steps on either side: no somersault
LOST_S, EDGE_S = 0.5, 0.2  # false detections at most, between right ones and at the ends of a clip
AT_ONCE_S = 0.1  # between frames that are compared
LONG = 0.22  # of a trunk, in sizes: one that points at the camera turns fast in the picture
BACK = 0.5  # share of the jump within which the trunk is where it was
TURNED_OVER = -0.5  # cosine of a trunk's direction before and after a jump, at most


def lost_frames(
    xy_px: Float[np.ndarray, "T K 2"],
    size_px: Float[np.ndarray, " T"],
    names: Sequence[str],
    fps: float,
) -> Bool[np.ndarray, " T"]:
    """In which frames the detector lost the body: both sides of the trunk jump as no trunk moves,
    and soon come back, or a clip begins or ends with such a jump; or the body is upside down
    between such jumps, or before or after one, for less of the clip than it is not.

    Of people who lie, BlazePose's first frame is often one, and a folded body often is for some
    frames. In hand-made labels of 1,745 clips (Penn Action) these are 15 of 123,002 frames.

    Args:
        xy_px: keypoints, NaN where missing. size_px: of the person.
        names: of the keypoints; a layout without shoulders or hips has no such frames.
    """
    lost = np.zeros(len(xy_px), dtype=bool)
    ends = [f"{side}_{part}" for part in ("hip", "shoulder") for side in ("left", "right")]
    if not set(ends) <= set(names):
        return lost
    columns = [list(names).index(end) for end in ends]
    sides = (xy_px[:, columns[:2]] - xy_px[:, columns[2:]]) / size_px[:, None, None]
    trunk = np.concatenate([sides, sides.mean(axis=1, keepdims=True)], axis=1)
    frames = np.flatnonzero(np.isfinite(trunk).all(axis=(1, 2)))
    if len(frames) < 2:
        return lost
    trunk, time_s = trunk[frames], frames / fps
    step = np.linalg.norm(np.diff(trunk, axis=0), axis=-1).min(axis=-1)
    over = _turned_over(trunk, _jumps(trunk, step, np.diff(time_s)))
    if over.any():
        lost[frames[over]] = True
        frames, trunk, time_s = frames[~over], trunk[~over], time_s[~over]
        step = np.linalg.norm(np.diff(trunk, axis=0), axis=-1).min(axis=-1)
    right = 0  # the trunk is right here, as far as it is judged
    for last in _jumps(trunk, step, np.diff(time_s)):
        if last < right:
            continue
        away = np.linalg.norm(trunk[last + 1 :] - trunk[last], axis=-1).max(axis=-1)
        soon = time_s[last + 1 :] - time_s[last] <= LOST_S
        back = np.flatnonzero((away <= BACK * step[last]) & soon)
        begins = right == 0 and time_s[last] - time_s[0] < EDGE_S
        if begins and not (len(back) and back[0] < last + 1):
            lost[: frames[last + 1]] = True
            right = last + 1
        elif len(back):
            right = last + 1 + int(back[0])
            lost[frames[last] + 1 : frames[right]] = True
        elif time_s[-1] - time_s[last + 1] < EDGE_S:
            lost[frames[last] + 1 :] = True
            break
    return lost


def _turned_over(trunk: Float[np.ndarray, "F 3 2"], jumps: Sequence[int]) -> Bool[np.ndarray, " F"]:
    """Which of F frames show the body upside down: those after an odd number of flips in which the
    trunk does point against the others' mean."""
    way = trunk[:, -1] / np.maximum(np.linalg.norm(trunk[:, -1], axis=-1, keepdims=True), 1e-9)
    turns = np.zeros(len(trunk), dtype=int)
    for last in jumps:
        turns[last + 1] = way[last] @ way[last + 1] < TURNED_OVER
    is_other = np.cumsum(turns) % 2 == 1
    if 2 * is_other.sum() > len(is_other):
        is_other = ~is_other
    return is_other & (way @ way[~is_other].mean(axis=0) < 0)


def _jumps(
    trunk: Float[np.ndarray, "F 3 2"], step: Float[np.ndarray, " _"], gap_s: Float[np.ndarray, " _"]
) -> list[int]:
    """After which of F frames a trunk that lies across the view changes as no trunk does.

    step: the change to the next frame, in sizes, gap_s later.
    """
    usual = median_filter(step, 2 * AROUND + 1, mode="mirror")
    fast = np.maximum(TRUNK_PER_S * np.maximum(gap_s, 1 / 30), SUDDEN * usual)
    length = np.linalg.norm(trunk, axis=-1).min(axis=-1)
    across = np.maximum(length[:-1], length[1:]) > LONG
    return np.flatnonzero((step > fast) & (gap_s <= AT_ONCE_S) & across).tolist()
