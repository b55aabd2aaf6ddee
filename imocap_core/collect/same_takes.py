"""Occurrences that show one take, replays included, and the one of each group that stays.

Replays: the same take shown again, at another speed, cropped, scaled or mirrored. Two showings of
one take have the same keypoints up to one similarity of the picture and a map of time that only
advances, and the same picture of the person along that map. Two performances in front of one camera
have the same background, but neither of these.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from imocap_core.collect.films import ShotTrack, pictures_of
from imocap_core.collect.listing import Occurrence, SameTakeAs
from imocap_core.diagnostics.contradictions import person_size
from imocap_core.diagnostics.same_take import moving_frames, nearest, picture_similarity, upsampled
from imocap_core.sequences import theil_sen_slope

NEAR = 0.0125  # of the person's size: root mean square over the keypoints, median over frames
CENTRE = 0.0045  # of the person's size: distance of the keypoints' centres, median over frames
UNLIKE = 0.05  # as NEAR, of poses about their centres
ALIKE = 0.95  # correlation of the pictures of the person, median over frames
ADVANCING = 0.7  # of the frames lie on one line of time,
ASIDE = 0.1  # of the duration: or so near to it
LEAST_MOVING = 8  # frames
POSITIONS_PER_FRAME = 4
PLAYED = np.geomspace(0.2, 5.0, 57)  # frames of the second a frame of the first
PATCH = 64  # side of the compared pictures of the person
COMPARED = 9  # pictures


@dataclass(frozen=True)
class Replay:
    """Frames of one track that show those of another again.

    rate: frames of the second a frame of the first. frames, repeated: corresponding frames, of the
    first and of the second track. scale, shift, mirrored: x_first = scale x_second + shift, after
    x -> -x where mirrored.
    """

    rate: float
    frames: Int[np.ndarray, " N"]
    repeated: Int[np.ndarray, " N"]
    scale: float
    shift: Float[np.ndarray, "2"]
    mirrored: bool


def repeated_motion(
    first_px: Float[np.ndarray, "T K 2"],
    second_px: Float[np.ndarray, "S K 2"],
    fps: float,
    twins: Sequence[int],
) -> Replay | None:
    """Whether the moving frames of the first track are all in the second one, as far as keypoints
    say; None if not, or where too little moves.

    Args:
        twins: each keypoint's left-right counterpart.
    """
    for mirrored in (False, True):
        second = second_px[:, list(twins)] * [-1.0, 1.0] if mirrored else second_px
        usable = np.isfinite(first_px).all(-1).mean(0) > 0.8
        usable &= np.isfinite(second).all(-1).mean(0) > 0.8
        if usable.sum() < 6:
            continue
        replay = _repeated(first_px[:, usable], second[:, usable], fps, mirrored)
        if replay is not None:
            return replay
    return None


def _repeated(
    a: Float[np.ndarray, "T K 2"], b: Float[np.ndarray, "S K 2"], fps: float, mirrored: bool
) -> Replay | None:
    moving = moving_frames(a, fps)
    complete = np.flatnonzero(np.isfinite(b).all((1, 2)))
    if len(moving) < LEAST_MOVING or len(complete) < LEAST_MOVING:
        return None
    size = person_size(a)
    x, y = a[moving], upsampled(b[complete], POSITIONS_PER_FRAME)
    scale = size / person_size(b)
    index, distance = nearest(x - x.mean(1, keepdims=True), scale * (y - y.mean(1, keepdims=True)))
    if np.median(distance) > UNLIKE * size:
        return None
    shift = np.zeros(2)
    for _ in range(4):
        scale, shift = picture_similarity(y[index], x)
        index, distance = nearest(x, scale * y + shift)
    position = np.interp(index / POSITIONS_PER_FRAME, np.arange(len(complete)), complete)
    rate = _slope(moving, position)
    if rate <= 0:  # it goes back the way it came: the nearest frame may be on the way there
        index, distance = _at_constant_rate(x, scale * y + shift, moving)
        position = np.interp(index / POSITIONS_PER_FRAME, np.arange(len(complete)), complete)
        rate = _slope(moving, position)
    aside = np.linalg.norm((x - scale * y[index] - shift).mean(axis=1), axis=-1)
    if np.median(distance) > NEAR * size or np.median(aside) > CENTRE * size or rate <= 0:
        return None
    repeated = np.rint(position).astype(int)
    return Replay(rate, moving, repeated, scale, shift, mirrored)


def _at_constant_rate(
    x: Float[np.ndarray, "N K 2"], y: Float[np.ndarray, "P K 2"], frames: Int[np.ndarray, " N"]
) -> tuple[Int[np.ndarray, " N"], Float[np.ndarray, " N"]]:
    """The frames of y that x repeats if it is played at one speed, and their distances."""
    flat_x, flat_y = x.reshape(len(x), -1), y.reshape(len(y), -1)
    square = (flat_x**2).sum(1)[:, None] + (flat_y**2).sum(1) - 2 * flat_x @ flat_y.T
    distance = np.sqrt(np.maximum(square, 0.0) / x.shape[1])
    rows, elapsed = np.arange(len(x)), frames - frames[0]
    best, chosen = np.inf, np.zeros(len(x), dtype=int)
    for rate in PLAYED:
        steps = np.rint(POSITIONS_PER_FRAME * rate * elapsed).astype(int)
        begins = np.arange(max(0, len(y) - steps[-1]))
        if len(begins):
            columns = begins[:, None] + steps
            medians = np.median(distance[rows, columns], axis=1)
            if medians.min() < best:
                best, chosen = float(medians.min()), columns[int(medians.argmin())]
    return chosen, distance[rows, chosen]


def _slope(frames: Int[np.ndarray, " N"], position: Float[np.ndarray, " N"]) -> float:
    """Frames of the second a frame of the first; 0 where time does not advance."""
    slope = theil_sen_slope(frames, position)
    offset = position - slope * frames
    aside = np.abs(offset - np.median(offset))
    return slope if (aside < ASIDE * slope * np.ptp(frames)).mean() > ADVANCING else 0.0


def compared_pairs(replay: Replay) -> list[tuple[int, int]]:
    """Corresponding frames of both tracks whose pictures are to be compared."""
    rows = np.unique(np.linspace(0, len(replay.frames) - 1, COMPARED).round().astype(int))
    return [(int(replay.frames[row]), int(replay.repeated[row])) for row in rows]


def same_picture(
    first: UInt8[np.ndarray, "H W"],
    second: UInt8[np.ndarray, "H2 W2"],
    box_px: Float[np.ndarray, "4"],
    replay: Replay,
) -> float:
    """Correlation of the first picture in the person's box with the second one brought onto it."""
    x0, y0, x1, y1 = box_px
    zoom = PATCH / max(x1 - x0, y1 - y0, 1.0)
    to_patch = np.array([[zoom, 0, -zoom * x0], [0, zoom, -zoom * y0], [0, 0, 1]])
    sign = -1.0 if replay.mirrored else 1.0
    onto = np.array(
        [[sign * replay.scale, 0, replay.shift[0]], [0, replay.scale, replay.shift[1]], [0, 0, 1]]
    )
    size = (max(8, round(zoom * (x1 - x0))), max(8, round(zoom * (y1 - y0))))
    a, b = (
        cv2.GaussianBlur(cv2.warpAffine(picture, warp[:2], size, flags=cv2.INTER_AREA), (0, 0), 1.5)
        for picture, warp in ((first, to_patch), (second, to_patch @ onto))
    )
    a, b = (x.astype(float) - x.mean() for x in (a, b))
    spread = float(np.sqrt((a * a).sum() * (b * b).sum()))
    return float((a * b).sum()) / spread if spread > 0 else 0.0


Pair = tuple[int, int]
Pictures = dict[int, dict[int, UInt8[np.ndarray, "H W"]]]  # by film and frame


def showings(
    occurrences: Sequence[Occurrence],
    tracks: Sequence[ShotTrack],
    films: Sequence[Path],
    twins: Sequence[int],
) -> dict[int, SameTakeAs]:
    """Occurrences that show a take again, by index, and the better showing that stays.

    Args:
        tracks: of the occurrences, the person in the whole shot.
        films: the files. twins: each keypoint's left-right counterpart.
    """
    suspects: dict[Pair, Replay] = {}
    for i, k in combinations(range(len(occurrences)), 2):
        replay = _either_way(i, k, occurrences, tracks, twins)
        if replay is not None:
            suspects[replay[0]] = replay[1]
    pictures = _pictures(suspects, occurrences, tracks, films)
    same = {
        pair: replay
        for pair, replay in suspects.items()
        if _alike(pair, replay, occurrences, tracks, pictures) >= ALIKE
    }
    return _groups(occurrences, same)


def shows_again(first: ShotTrack, second: ShotTrack, twins: Sequence[int]) -> bool:
    """Whether the one track has all the moving keypoints of the other."""
    pairs = ((first, second), (second, first))
    return any(repeated_motion(a.xy_px, b.xy_px, a.fps, twins) is not None for a, b in pairs)


def _either_way(
    i: int,
    k: int,
    occurrences: Sequence[Occurrence],
    tracks: Sequence[ShotTrack],
    twins: Sequence[int],
) -> tuple[Pair, Replay] | None:
    """The pair and its replay: all of the one in the other, or the other way round."""
    if (occurrences[i].film, occurrences[i].shot) == (occurrences[k].film, occurrences[k].shot):
        return None
    for a, b in ((i, k), (k, i)):
        of_a = slice(*(t - tracks[a].first for t in (occurrences[a].first, occurrences[a].stop)))
        replay = repeated_motion(tracks[a].xy_px[of_a], tracks[b].xy_px, tracks[a].fps, twins)
        if replay is not None:
            return (a, b), replay
    return None


def _frames(
    pair: Pair, replay: Replay, occurrences: Sequence[Occurrence], tracks: Sequence[ShotTrack]
) -> list[tuple[int, int]]:
    """Corresponding frames of both films."""
    first, second = occurrences[pair[0]].first, tracks[pair[1]].first
    return [(first + a, second + b) for a, b in compared_pairs(replay)]


def _pictures(
    suspects: dict[Pair, Replay],
    occurrences: Sequence[Occurrence],
    tracks: Sequence[ShotTrack],
    films: Sequence[Path],
) -> Pictures:
    wanted: dict[int, set[int]] = defaultdict(set)
    for pair, replay in suspects.items():
        for a, b in _frames(pair, replay, occurrences, tracks):
            wanted[occurrences[pair[0]].film].add(a)
            wanted[occurrences[pair[1]].film].add(b)
    return {film: pictures_of(films[film], frames) for film, frames in wanted.items()}


def _alike(
    pair: Pair,
    replay: Replay,
    occurrences: Sequence[Occurrence],
    tracks: Sequence[ShotTrack],
    pictures: Pictures,
) -> float:
    """Median correlation of the pictures of the person in corresponding frames."""
    first, second = (occurrences[i] for i in pair)
    track = tracks[pair[0]]
    values = []
    for a, b in _frames(pair, replay, occurrences, tracks):
        box = track.box_px[a - track.first]
        if np.isfinite(box).all():
            values.append(
                same_picture(pictures[first.film][a], pictures[second.film][b], box, replay)
            )
    return float(np.median(values)) if values else 0.0


def _groups(occurrences: Sequence[Occurrence], same: dict[Pair, Replay]) -> dict[int, SameTakeAs]:
    """Of every group of showings, all but the best, with the best one and the ratio of speeds."""
    group = list(range(len(occurrences)))
    for i, k in same:
        old, new = group[k], group[i]
        group = [new if g == old else g for g in group]
    again: dict[int, SameTakeAs] = {}
    for number in set(group):
        members = [i for i, g in enumerate(group) if g == number]
        best = max(members, key=lambda i: occurrences[i].quality)
        for i in members:
            if i != best:
                again[i] = SameTakeAs(best, _speed(i, best, occurrences, same))
    return again


def _speed(i: int, best: int, occurrences: Sequence[Occurrence], same: dict[Pair, Replay]) -> float:
    """Speed of one showing, times another's."""
    if (best, i) in same:
        return 1 / same[best, i].rate
    if (i, best) in same:
        return same[i, best].rate
    return occurrences[i].rate / occurrences[best].rate
