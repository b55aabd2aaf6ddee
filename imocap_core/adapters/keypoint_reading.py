"""Keypoints beside the video that they are of: their pixels, frame numbers and rate.

What action.yaml declares of a video, against the evidence: its file, and its keypoints. A wrong
size or focal length would put the performer kilometres away and pull every other video's camera
with it, so it ends the run with a sentence.

A detector may have run on another version of the video: a smaller copy, stored pixels that are not
square, pictures numbered from 1, every second frame. Numbers and reach say what is possible, and
the pictures which of it is so: points move as the picture does there. What fits one simple
explanation is read that way, and said; the rest is refused.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from imocap_core.body.layouts import layout_names
from imocap_core.camera.projection import Lens, intrinsics
from imocap_core.conventions import mirror_indices
from imocap_core.io.readers.people import DetectedPeople, People, between_people
from imocap_core.io.video import SLOWED, UPRIGHT, GrayPicture, PictureDisplay, VideoInfo, read_gray
from imocap_core.limits import MAX_FOCAL, MIN_FOCAL
from imocap_core.people.shot_boundaries import Agreement
from imocap_core.pipeline.action import Declaration

FPS_TOLERANCE = 0.02  # 29.97 may be declared as 30
OUTSIDE, OUTSIDE_SHARE = 0.1, 0.3  # of the picture; of the points
LEAST_EXTENT_PX = 2.0  # of a person, in the frame where they are largest
LEAST_REACH = 0.25  # of the picture's width and height that all people of a clip reach


def check_declared(declared: Declaration, probed: VideoInfo | None, file: Path) -> None:
    """ValueError when size, fps or focal_px are not what the video's file says, or no camera's.

    file: the action.yaml, for messages.
    """
    where = f"{file}: videos.{declared.id}"
    if probed is not None and declared.size not in (None, probed.size):
        assert declared.size is not None
        raise ValueError(
            f"{where}.size: expected {list(probed.size)}, as {declared.video} has, got "
            f"{list(declared.size)}; leave size out where there is a video"
        )
    if probed is not None and declared.fps is not None:
        off = _times_off(declared.fps, probed)
        if FPS_TOLERANCE < off - 1 < SLOWED - 1:
            raise ValueError(
                f"{where}.fps: expected {probed.fps:g}, as {declared.video} has, got "
                f"{declared.fps:g}; leave fps out where there is a video, unless it is slow motion "
                f"or a time lapse, {SLOWED} times slower or faster than it was taken"
            )
    size = declared.size if probed is None else probed.size
    if declared.focal_px is not None and size is not None:
        least, most = MIN_FOCAL * max(size), MAX_FOCAL * max(size)
        if not least <= declared.focal_px <= most:
            raise ValueError(
                f"{where}.focal_px: expected {least:.0f} to {most:.0f} pixels for pictures of "
                f"{size[0]} x {size[1]}, got {declared.focal_px:g}; leave it out where it is not "
                f"known"
            )
        _check_lens(declared, size, where)


def at_declared_rate(declared: Declaration, probed: VideoInfo) -> VideoInfo:
    """A file with the rate at which it was taken, where action.yaml says that it was another."""
    if declared.fps is None or _times_off(declared.fps, probed) < SLOWED:
        return probed
    return probed.taken_at(declared.fps)


def _times_off(fps: float, probed: VideoInfo) -> float:
    """How many times slower or faster the file is, at least 1."""
    return max(fps / probed.fps, probed.fps / fps)


def _check_lens(declared: Declaration, size: tuple[int, int], where: str) -> None:
    """ValueError for a distortion that does not show the picture from side to side."""
    if declared.distortion is None or declared.focal_px is None:
        return
    lens = Lens.of(declared.distortion, intrinsics(declared.focal_px, size))
    if lens.reach_px < max(size) / 2:
        raise ValueError(
            f"{where}.distortion: expected a lens that shows pictures of {size[0]} x {size[1]}, "
            f"got one that turns back on itself {lens.reach_px:.0f} pixels from the middle; its "
            f"numbers belong to a focal length, which is focal_px: {declared.focal_px:g} here"
        )


def check_fits_picture(
    xy_px: Float[np.ndarray, "T K 2"], size: tuple[int, int], folder: Path, *, probed: bool
) -> None:
    """ValueError when many points are far outside the picture, or all in a small corner of it, as
    pixels of another size are.

    probed: the size is that of the video's file; then somebody may well be in the corner.
    """
    share = xy_px[np.isfinite(xy_px).all(axis=-1)] / np.array(size)
    outside = ((share < -OUTSIDE) | (share > 1 + OUTSIDE)).any(axis=-1)
    if not len(share):
        return
    present = xy_px[np.isfinite(xy_px).all(axis=-1).any(axis=1)]
    extent = np.nanmax(present, axis=1) - np.nanmin(present, axis=1)
    if extent.max() < LEAST_EXTENT_PX:
        raise ValueError(
            f"{folder}: expected a person, got points that lie on one spot in every frame; check "
            f"the detections"
        )
    in_corner = not probed and share.max() < LEAST_REACH
    if outside.mean() <= OUTSIDE_SHARE and not in_corner:
        return
    x, y = (share.max(axis=0) * size).round().astype(int)
    raise ValueError(
        f"{folder}: expected pixels of a picture of {size[0]} x {size[1]}, got points that reach "
        f"({x}, {y}); run the detector on this very video, or correct `size` in action.yaml"
    )


RATES = tuple(Fraction(*r) for r in (
    (2, 1), (3, 1), (4, 1), (5, 1), (8, 1), (3, 2), (4, 3), (5, 4), (6, 5), (5, 3), (5, 2), (12, 5),
))  # fmt: skip
SCALES = tuple(Fraction(*r) for r in (
    (4, 3), (3, 2), (2, 1), (9, 4), (8, 3), (3, 1), (4, 1), (9, 2), (6, 1),
))  # fmt: skip
INSIDE, MOST_OUTSIDE = 0.02, 0.05  # of the picture; of the points
LITTLE_REACH = 0.75  # of a picture: what reaches less may be of a smaller copy
SHARES = 1.5  # points that reach no further are shares of the picture
CORNER = 0.5
PAIRS, STEP, LOOKED_AT, LARGER_PX = 40, 2, 600, 480
LEAST, CLEARLY = 0.2, 0.1  # agreement with the pictures, and its lead over another reading
SEEN = 0.3  # confidence of points that are compared
ORDINALS = ("", "", "2nd", "3rd", "4th", "5th", "6th", "7th", "8th")
FEW, MAX_STEP = 6, 8  # frames of keypoints that show a step; frames from one to the next
OFF_END = 2  # frames that detectors and decoders may differ by


@dataclass(frozen=True)
class Reading:
    """Which keypoints belong to which frames and pixels of the video.

    Attributes:
        first: number of the keypoints of the video's frame 0.
        rate: numbers of keypoints a frame.
        step: of the numbers, where only every second frame or so was detected.
        linear, shift: shown pixels = linear @ pixels of the file + shift.
        exchanged: the file has y before x.
        words: how they are read, empty for as they are.
    """

    first: int = 0
    rate: Fraction = Fraction(1)
    step: int = 1
    linear: tuple[tuple[float, float], tuple[float, float]] = ((1.0, 0.0), (0.0, 1.0))
    shift: tuple[float, float] = (0.0, 0.0)
    exchanged: bool = False
    words: tuple[str, ...] = ()

    def places(self, file_px: Float[np.ndarray, "*any 2"]) -> Float[np.ndarray, "*any 2"]:
        """Pixels of the shown picture."""
        return np.asarray(file_px @ np.array(self.linear).T + np.array(self.shift))

    def in_file(self, shown_px: Float[np.ndarray, "*any 2"]) -> Float[np.ndarray, "*any 2"]:
        """The inverse of `places`."""
        back = np.linalg.inv(np.array(self.linear))
        return np.asarray((shown_px - np.array(self.shift)) @ back.T)

    def number(self, frames: Int[np.ndarray, " T"]) -> Float[np.ndarray, " T"]:
        """(Fractional) numbers of the keypoints of frames."""
        return np.asarray(self.first + float(self.rate) * frames)

    def by_place(self, given: DetectedPeople) -> dict[int, People]:
        """The people of a file by their place in it: its frame number, in steps."""
        places = (given.frames - given.frames[0] % self.step) // self.step
        return dict(zip(places.tolist(), given.people, strict=True))

    def places_of(self, frames: Int[np.ndarray, " T"], given: DetectedPeople) -> list[float]:
        """(Fractional) places in the file of the keypoints of frames."""
        places = (self.number(frames) - given.frames[0] % self.step) / self.step
        return [float(place) for place in places]

    @property
    def mirrored(self) -> bool:
        """Whether the keypoints are of the mirror image of the shown picture."""
        return bool(np.linalg.det(np.array(self.linear)) < 0) != self.exchanged

    def read(self, given: DetectedPeople, count: int, layout: str) -> DetectedPeople:
        """The people of the video's frames 0 to count - 1, where there are any."""
        if not self.words:
            return given
        people, nobody = self.by_place(given), given.people[0][:0]
        frames = np.arange(count)
        readings = [between_people(people, n, nobody) for n in self.places_of(frames, given)]
        placed = [np.concatenate([self.places(p[..., :2]), p[..., 2:]], axis=-1) for p in readings]
        if self.mirrored:
            twins = list(mirror_indices(layout_names(layout)))
            placed = [p[:, twins] for p in placed]
        return DetectedPeople(frames, tuple(placed))


def reading_of(
    given: DetectedPeople,
    info: VideoInfo,
    video: Path,
    where: Path,
    *,
    used: tuple[int, int] | None = None,
    placed: bool = False,
) -> Reading:
    """How the keypoints of a file are those of a video.

    Args:
        where: the keypoints, for messages.
        used: first and one past the last used frame, where declared.
        placed: the points are in pixels of the shown picture for sure.

    ValueError when they are of another video, or of no version of it that is known.
    """
    times = _in_steps(_timings(given.frames, info.frame_count, where, used), given.frames)
    places = [Reading()] if placed else _in_both_orders(_placings(given, info), given, info.size)
    options = [
        replace(
            time,
            linear=place.linear,
            shift=place.shift,
            exchanged=place.exchanged,
            words=(*time.words, *place.words),
        )
        for time in times
        for place in places
    ]
    if len(options) == 1:
        return options[0]
    scores = _agreements(options, given, info, video)
    best = int(np.argmax(np.nan_to_num(scores, nan=-1.0)))
    if best and scores[best] >= LEAST and not scores[best] - scores[0] < CLEARLY:
        return options[best]
    reach = _reach(options[0].places(_points(given)), info.size)
    if np.isfinite(scores[0]) and scores[0] < CLEARLY and reach < CORNER:
        raise ValueError(
            f"{where}: its points lie in a corner of the picture of {info.size[0]} x "
            f"{info.size[1]} and do not move with it; run the detector on this very video"
        )
    return options[0]


def _timings(
    numbers: Int[np.ndarray, " N"], count: int, where: Path, used: tuple[int, int] | None
) -> list[Reading]:
    """Readings of the frame numbers, the first one without evidence from the pictures."""
    first, last = int(numbers[0]), int(numbers[-1])
    span = last - first + 1
    if (first == 1 and last <= count) or first >= 1 == last - count + 1:
        base = Reading(first=1, words=("the keypoints are numbered from 1",))
    elif first > 1 and last >= count and abs(span - count) <= OFF_END:
        base = Reading(first=first, words=(f"the keypoints are numbered from {first}",))
    elif first >= count or (first > 1 and last >= count + OFF_END):
        raise ValueError(
            f"{where}: its frames are numbered {first} to {last}, and the video has {count} "
            f"(0 to {count - 1}); run the detector on this very video, or number them from 0"
        )
    else:
        base = Reading()
    zero = base.first if base.words else min(first, 1)
    total = last + 1 - zero
    every: list[Fraction] = [r for q in RATES for r in (q, 1 / q)]
    rates = [r for r in every if abs(total - r * count) <= max(Fraction(1), r)]
    others = [_at_rate(r, zero, total, count) for r in rates if abs(total - count) > OFF_END]
    if total > count + OFF_END:
        if not others:
            raise ValueError(
                f"{where}: keypoints of {total} frames, and the video has {count}; they are of "
                f"another version of it: run the detector on this very video"
            )
        longer = f"the keypoints go on after the video's last frame, to frame {total - 1}"
        return [*others, replace(base, words=(*base.words, longer))]
    is_dense = len(numbers) == span
    if used is not None and used[0] > 0 and first <= 1 and span == used[1] - used[0]:
        others.append(
            Reading(first - used[0], words=(f"the keypoints are numbered from frame {used[0]} on",))
        )
    return [*others, base] if others and is_dense and total < 0.6 * count else [base, *others]


def _in_steps(times: list[Reading], numbers: Int[np.ndarray, " N"]) -> list[Reading]:
    """The same of a file that has only every second frame or so, under its number."""
    apart = np.diff(numbers)
    step = int(np.gcd.reduce(apart)) if len(apart) >= FEW else 1
    if not (1 < step <= MAX_STEP and np.median(apart) == step):
        return times
    words = f"the keypoints are of every {ORDINALS[step]} frame: the others are between these"
    return [replace(time, step=step, words=(*time.words, words)) for time in times]


def _at_rate(rate: Fraction, first: int, total: int, count: int) -> Reading:
    words = f"the keypoints are of {total} frames and the video has {count}: read at {rate} a frame"
    return Reading(first=first, rate=rate, words=(words,))


def _placings(given: DetectedPeople, info: VideoInfo) -> list[Reading]:
    """Readings of the points' places, the first one without evidence from the pictures."""
    points, size = _points(given), info.size
    if not len(points):
        return [Reading()]
    if _are_shares(points, size):
        return _shares(points, size)
    bases = _displays(info)
    fitting = [base for base in bases if _fits(base.places(points), size)]
    options = list(fitting)
    for base in bases:
        reach = _reach(base.places(points), size)
        if base in fitting and reach > LITTLE_REACH:
            continue
        scales = SCALES if base in fitting else tuple(1 / s for s in SCALES)
        for scale in scales:
            scaled = _scaled(base, scale)
            if _fits(scaled.places(points), size) and scale * reach >= 0.3:
                options.append(scaled)
    if not fitting:  # `check_fits_picture` refuses it unless the pictures speak for another
        return [bases[0], *options]
    return options


def _in_both_orders(
    places: list[Reading], given: DetectedPeople, size: tuple[int, int]
) -> list[Reading]:
    """The same, and with y before x where the points are shares (MoveNet's are so), or where that
    makes lying people stand."""
    people = [p[0, p[0, :, 2] > SEEN, :2] for p in given.people if len(p)]
    extents = [np.ptp(places[0].places(points), axis=0) for points in people if len(points) > 1]
    points = _points(given)
    if not extents or (
        np.subtract(*np.median(extents, axis=0)) <= 0 and not _are_shares(points, size)
    ):
        return places
    words = "the keypoints have y before x"
    turned = [
        replace(
            place,
            linear=((b, a), (d, c)),
            exchanged=not place.exchanged,
            words=(*place.words, words),
        )
        for place in places
        for (a, b), (c, d) in [place.linear]
    ]
    return [*places, *(place for place in turned if _fits(place.places(points), size))]


def reading_without_video(given: DetectedPeople, size: tuple[int, int]) -> Reading:
    """How keypoints alone are read, of pictures of a declared size."""
    points = _points(given)
    return _shares(points, size)[0] if _are_shares(points, size) else Reading()


def _are_shares(points: Float[np.ndarray, "N 2"], size: tuple[int, int]) -> bool:
    return bool(len(points) and np.abs(points).max() <= SHARES and max(size) > 20 * SHARES)


def _shares(points: Float[np.ndarray, "N 2"], size: tuple[int, int]) -> list[Reading]:
    """Points as shares of the picture, from 0 or from -1 to 1."""
    width, height = map(float, size)
    from_0 = Reading(
        linear=((width, 0.0), (0.0, height)),
        words=("the keypoints are shares of the picture, from 0 to 1",),
    )
    from_minus_1 = Reading(
        linear=((width / 2, 0.0), (0.0, height / 2)),
        shift=(width / 2, height / 2),
        words=("the keypoints are shares of the picture, from -1 to 1",),
    )
    if points.min() < -0.1:
        return [from_minus_1]
    return [from_0] if np.median(points) < 0.2 else [from_0, from_minus_1]


def _displays(info: VideoInfo) -> list[Reading]:
    """The picture as detectors see it: most read it through OpenCV, which turns it but leaves its
    pixels as they are; the others as it is shown, or as it is stored."""
    shown = info.display
    if shown is None or (shown.aspect == 1.0 and shown.axes == UPRIGHT):
        return [Reading()]
    turned = PictureDisplay(shown.stored, 1.0, shown.axes)
    kinds: dict[PictureDisplay, str] = {}
    for visible, what in (
        (turned, "pixels of the file, which are not square"),
        (shown, ""),
        (PictureDisplay(shown.stored), "pixels of the file as it is stored, not as it is shown"),
        (
            PictureDisplay(shown.stored, 1.0, ((-1, 0), (0, -1))),
            "pixels of the file, turned by 180",
        ),
    ):
        kinds.setdefault(visible, what if visible != shown else "")
    if not shown.mirrored:
        kinds.pop(PictureDisplay(shown.stored, 1.0, ((-1, 0), (0, -1))), None)
        kinds.setdefault(shown, "")
    return [_between(visible, shown, what) for visible, what in kinds.items()]


def _between(visible: PictureDisplay, shown: PictureDisplay, what: str) -> Reading:
    """From the picture that a detector saw to the one that is shown."""
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    a, b = visible.shown_points(corners), shown.shown_points(corners)
    linear = (b[1:] - b[0]).T @ np.linalg.inv((a[1:] - a[0]).T)
    shift = b[0] - linear @ a[0]
    return Reading(
        linear=((linear[0, 0], linear[0, 1]), (linear[1, 0], linear[1, 1])),
        shift=(shift[0], shift[1]),
        words=(f"the keypoints are in {what}",) if what else (),
    )


def _scaled(base: Reading, scale: Fraction) -> Reading:
    """The same of a copy of the video that is `scale` times smaller."""
    (a, b), (c, d) = base.linear
    s = float(scale)
    words = f"the keypoints are of a copy of {float(1 / scale):.3g} times the size"
    return replace(base, linear=((s * a, s * b), (s * c, s * d)), words=(*base.words, words))


def _points(given: DetectedPeople) -> Float[np.ndarray, "N 2"]:
    """All points that were detected with some confidence."""
    every = np.concatenate([p.reshape(-1, 3) for p in given.people])
    return every[every[:, 2] > SEEN, :2] if (every[:, 2] > SEEN).any() else every[:0, :2]


def _fits(points: Float[np.ndarray, "N 2"], size: tuple[int, int]) -> bool:
    share = points / np.array(size)
    outside = ((share < -INSIDE) | (share > 1 + INSIDE)).any(axis=-1)
    return bool(outside.mean() <= MOST_OUTSIDE)


def _reach(points: Float[np.ndarray, "N 2"], size: tuple[int, int]) -> float:
    """Larger share of the picture's width and height that (nearly) all points reach."""
    return float(np.quantile(points / np.array(size), 0.99, axis=0).max()) if len(points) else 0.0


def _agreements(
    options: Sequence[Reading], given: DetectedPeople, info: VideoInfo, video: Path
) -> list[float]:
    """How well the points move with the pictures, in each reading; NaN where none can be told."""
    people = [option.by_place(given) for option in options]
    scale, nobody = min(1.0, LARGER_PX / max(info.size)), given.people[0][:0]
    agreement = Agreement(len(options))
    for t, before, after in _pairs(video, min(info.frame_count, LOOKED_AT), scale):
        points = []
        for option, by_place in zip(options, people, strict=True):
            places = option.places_of(np.array([t, t + STEP]), given)
            ends = _same_points(*(between_people(by_place, n, nobody) for n in places))
            points.append((scale * option.places(ends[0]), scale * option.places(ends[1])))
        agreement.add(before, after, points)
    return agreement.values()


def _pairs(video: Path, count: int, scale: float) -> Iterator[tuple[int, GrayPicture, GrayPicture]]:
    """(frame, its picture, a little later one)."""
    starts = np.unique(np.linspace(0, max(count - 1 - STEP, 0), PAIRS).astype(int)).tolist()
    wanted, chosen = {*starts, *(t + STEP for t in starts)}, {}
    for number, picture in read_gray(video, 0, max(wanted) + 1, scale=scale):
        if number in wanted:
            chosen[number] = picture
        if number - STEP in starts:
            yield number - STEP, chosen[number - STEP], picture


def _same_points(
    people: Float[np.ndarray, "P K 3"], later: Float[np.ndarray, "Q K 3"]
) -> tuple[Float[np.ndarray, "N 2"], Float[np.ndarray, "N 2"]]:
    """Points that are seen in both frames, of the first person; of several the nearest later."""
    if not len(people) or not len(later):
        return np.zeros((0, 2)), np.zeros((0, 2))
    visible: Bool[np.ndarray, "Q K"] = (people[:1, :, 2] > SEEN) & (later[..., 2] > SEEN)
    away = np.where(visible, np.linalg.norm(later[..., :2] - people[0, :, :2], axis=-1), np.inf)
    if not np.isfinite(away).any():
        return np.zeros((0, 2)), np.zeros((0, 2))
    other = int(away.min(axis=1).argmin())
    return people[0, visible[other], :2], later[other, visible[other], :2]
