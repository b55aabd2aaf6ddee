"""The videos of an action: looked through in the background, pictures, strips, tracked people."""

from __future__ import annotations

import hashlib
import json
import math
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from queue import Empty, Queue
from threading import Event, Lock, Thread
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from imocap_core.adapters.tracked_people import NEGLIGIBLE, TrackedVideo
from imocap_core.body.layouts import layout_names
from imocap_core.errors import ImocapError
from imocap_core.io.frame_access import FrameReader, FrameStamps, all_frames
from imocap_core.io.video import probe
from imocap_core.params import KeypointsParams
from imocap_core.people.shot_boundaries import find_cuts
from imocap_core.people.tracking import box_of, size_of
from imocap_core.pipeline.action import Action, Declaration

END_S = 5.0


class BackgroundThread:
    """Runs jobs one after the other; a job that waits already is not queued again."""

    def __init__(self, name: str) -> None:
        self.stopping = Event()
        self._jobs: Queue[tuple[Hashable, Callable[[], None]]] = Queue()
        self._waiting: set[Hashable] = set()
        self._lock = Lock()
        self._thread = Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def add(self, key: Hashable, job: Callable[[], None]) -> None:
        """Queue a job, unless one of that key waits. Jobs handle their own errors."""
        with self._lock:
            if key in self._waiting or self.stopping.is_set():
                return
            self._waiting.add(key)
        self._jobs.put((key, job))

    def close(self) -> None:
        """End after the present job; long jobs look at `stopping`."""
        self.stopping.set()
        self._thread.join(END_S)

    def _run(self) -> None:
        while not self.stopping.is_set():
            try:
                key, job = self._jobs.get(timeout=0.1)
            except Empty:
                continue
            with self._lock:
                self._waiting.discard(key)
            job()


THUMB_PX = 160  # larger side
LARGE_PX = 1280
QUALITY = 82  # of JPEG
MOST_THUMBS = 240  # that stay in memory of one video
COMPARED_PX = 160  # larger side of the pictures in which cuts are looked for


@dataclass(frozen=True)
class Strip:
    """What the page shows of one file along time; `thumbs`: JPEG by frame, every `step` frames.

    cuts: frames with which a new shot begins.
    """

    fps: float
    size: tuple[int, int]
    count: int
    cuts: list[int]
    step: int
    thumbs: dict[int, bytes]
    stamps: FrameStamps


def _strip_of(path: Path, progress: Callable[[float], None]) -> Strip:
    """Look through a video; `progress` is called with the share done. ValueError when it cannot be
    read."""
    info = probe(path)
    step = max(1, math.ceil(info.frame_count / MOST_THUMBS))
    thumbs: dict[int, bytes] = {}
    stamps: list[int | None] = []
    keys: list[int] = []

    def pictures() -> Iterator[UInt8[np.ndarray, "height width"]]:
        for decoded in all_frames(path):
            stamps.append(decoded.stamp)
            if decoded.is_key:
                keys.append(decoded.number)
            if decoded.number % step == 0:
                thumbs[decoded.number] = jpeg(decoded.rgb(THUMB_PX))
            progress(min(1.0, (decoded.number + 1) / max(info.frame_count, 1)))
            yield decoded.gray(COMPARED_PX)

    cuts = find_cuts(pictures())
    return Strip(info.fps, info.size, len(stamps), cuts, step, thumbs, FrameStamps(stamps, keys))


def jpeg(picture: UInt8[np.ndarray, "height width 3"]) -> bytes:
    """A picture (RGB) as JPEG."""
    bgr = cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
    _, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return data.tobytes()


BEHIND = 10  # frames before one that is stepped back to, which are prepared too
MOST_BYTES = 24 * 2**20

SIDES_PX = {"thumb": THUMB_PX, "large": LARGE_PX}


class Pictures:
    """The pictures of one file, for several threads."""

    def __init__(self, path: Path, strip: Strip) -> None:
        self._strip = strip
        self._reader = FrameReader(path, strip.stamps)
        self._memory: OrderedDict[tuple[str, int], bytes] = OrderedDict()
        self._bytes, self._last = 0, 0
        self._lock = Lock()

    def get(self, kind: str, number: int) -> bytes | None:
        """A frame as JPEG, `kind` thumb or large; None where the video has no such frame.

        ValueError when it cannot be read.
        """
        if not 0 <= number < self._strip.count:
            return None
        if kind == "thumb" and number in self._strip.thumbs:
            return self._strip.thumbs[number]
        with self._lock:
            if (kind, number) not in self._memory:
                self._decode(kind, number)
            self._last = number
            picture = self._memory.get((kind, number))
            if picture is not None:
                self._memory.move_to_end((kind, number))
            return picture

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            self._reader.close()

    def _decode(self, kind: str, number: int) -> None:
        stepped_back = number < self._last <= number + BEHIND
        first = max(0, number - BEHIND) if stepped_back else number
        for decoded in self._reader.frames(first, number):
            self._put((kind, decoded.number), jpeg(decoded.rgb(SIDES_PX[kind])))

    def _put(self, key: tuple[str, int], picture: bytes) -> None:
        self._bytes += len(picture) - len(self._memory.pop(key, b""))
        self._memory[key] = picture
        while self._bytes > MOST_BYTES and len(self._memory) > 1:
            _, oldest = self._memory.popitem(last=False)
            self._bytes -= len(oldest)


MOST_OPEN = 4


@dataclass
class MediaFile:
    """One file: `share` of it looked through, then its strip and pictures, or a fault."""

    path: Path
    share: float = 0.0
    strip: Strip | None = None
    pictures: Pictures | None = None
    fault: str | None = None

    def document(self) -> dict[str, Any]:
        """What the page is told of it."""
        entry: dict[str, Any] = {"name": self.path.name, "share": round(self.share, 3)}
        if self.fault is not None:
            return entry | {"fault": self.fault}
        if self.strip is None:
            return entry
        strip = self.strip
        return entry | {
            "fps": strip.fps,
            "size": strip.size,
            "count": strip.count,
            "cuts": strip.cuts,
            "step": strip.step,
        }


class Media:
    """Files that an action.yaml declares; only these can be asked for, by number."""

    def __init__(self, thread: BackgroundThread) -> None:
        self._thread = thread
        self._files: list[MediaFile] = []
        self._numbers: dict[Path, int] = {}
        self._open: list[Pictures] = []
        self._lock = Lock()

    def number(self, path: Path) -> int:
        """The number of a file, which is looked through from now on when it is new."""
        with self._lock:
            if path in self._numbers:
                return self._numbers[path]
            file = MediaFile(path)
            self._files.append(file)
            self._numbers[path] = len(self._files) - 1
        self._thread.add(("strip", path), lambda: self._look_through(file))
        return self._numbers[path]

    def file(self, number: int) -> MediaFile | None:
        """The file of a number."""
        return self._files[number] if 0 <= number < len(self._files) else None

    def count(self, path: Path) -> int | None:
        """Frames of a file, where they are counted."""
        strip = self._files[self._numbers[path]].strip if path in self._numbers else None
        return None if strip is None else strip.count

    def picture(self, number: int, kind: str, frame: int) -> bytes | None:
        """A frame of a file as JPEG (arguments as of `Pictures.get`); None where there is none.

        The files that were asked last stay open, because open ones take much memory.
        """
        file = self.file(number)
        if file is None or file.pictures is None:
            return None
        with self._lock:
            self._open = [*(p for p in self._open if p is not file.pictures), file.pictures]
            closing, self._open = self._open[:-MOST_OPEN], self._open[-MOST_OPEN:]
        for pictures in closing:
            pictures.close()
        return file.pictures.get(kind, frame)

    def documents(self) -> list[dict[str, Any]]:
        """All files for the page, by number."""
        return [file.document() for file in self._files]

    def close(self) -> None:
        """Close all files."""
        for file in self._files:
            if file.pictures is not None:
                file.pictures.close()

    def _look_through(self, file: MediaFile) -> None:
        def progress(share: float) -> None:
            if self._thread.stopping.is_set():
                raise ValueError("stopped")
            file.share = share

        try:
            strip = _strip_of(file.path, progress)
        except (ValueError, OSError, MemoryError) as error:
            file.fault = str(error)
            return
        file.pictures = Pictures(file.path, strip)
        file.strip = strip


MASK_PX = 72.0  # diagonal of the person's box in the picture in which the outline is traced
LIMB = 0.075  # thickness of a limb over that diagonal
HEAD = 0.07  # radius of the head
MARGIN_PX = 10
MOST_PEOPLE = 12
MOST_FRAMES = 3000  # with outlines; longer videos have them every few frames
OUTLINED_CHAINS = (
    ("shoulder", "elbow", "wrist"),
    ("hip", "knee", "ankle", "heel"),
    ("ankle", "big_toe"),
)


def outlines_of(video: TrackedVideo) -> dict[str, Any]:
    """Everybody in a video by frame: number as in `imocap people`, box and polygon in pixels."""
    step = max(1, math.ceil(len(video.frames) / MOST_FRAMES))
    names = layout_names(video.layout)
    best = video.ranked[0][0] if video.ranked else 1.0
    people = [
        {
            "number": number,
            "score": round(score / best, 3),
            "frames": [int(video.frames[t]) for t in track.frames[::step]],
            "boxes": [_whole(box_of(pose)) for pose in track.poses[::step]],
            "outlines": [_whole(outline(pose, names)) for pose in track.poses[::step]],
        }
        for number, (score, track) in enumerate(video.ranked[:MOST_PEOPLE], start=1)
        if number == 1 or (score > NEGLIGIBLE * best and len(track.frames) > 1)
    ]
    first, last = int(video.frames[0]), int(video.frames[-1])
    return {"frames": [first, last + 1], "step": step, "size": video.size, "people": people}


def outline(pose: Float[np.ndarray, "K 3"], names: Sequence[str]) -> Float[np.ndarray, "P 2"]:
    """The polygon around a person's limbs, trunk and head, in pixels."""
    box = box_of(pose)
    scale = MASK_PX / size_of(pose)
    width, height = (np.ceil((box[2:] - box[:2]) * scale) + 2 * MARGIN_PX).astype(int)
    mask = np.zeros((int(height), int(width)), np.uint8)
    _paint(mask, {
        name: tuple(np.rint((xy - box[:2]) * scale + MARGIN_PX).astype(int).tolist())
        for name, xy, confidence in zip(names, pose[:, :2], pose[:, 2], strict=True)
        if confidence > 0
    })  # fmt: skip
    polygon = _one_contour(mask)
    smooth = cv2.approxPolyDP(polygon, 0.9, True).reshape(-1, 2).astype(float)
    return (smooth - MARGIN_PX) / scale + box[:2]


def _one_contour(mask: UInt8[np.ndarray, "H W"]) -> Any:
    """The outer contour of all that is painted, parts joined where they are nearest."""
    while True:
        contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        if len(contours) == 1:
            return contours[0]
        part = contours[0].reshape(-1, 1, 2)
        others = np.concatenate(contours[1:]).reshape(1, -1, 2)
        distances = np.linalg.norm((part - others).astype(float), axis=-1)
        a, b = np.unravel_index(distances.argmin(), distances.shape)
        ends = tuple(map(int, part[a, 0])), tuple(map(int, others[0, b]))
        cv2.line(mask, *ends, 255, max(2, round(LIMB * MASK_PX)))


def _paint(mask: UInt8[np.ndarray, "H W"], points: dict[str, tuple[int, int]]) -> None:
    """Paint a body's limbs, trunk and head; points that belong to none of them as dots."""
    thick = max(2, round(LIMB * MASK_PX))
    for point in points.values():
        cv2.circle(mask, point, thick // 2, 255, -1)
    for side in ("left", "right"):
        for limb in OUTLINED_CHAINS:
            ends = [points[f"{side}_{part}"] for part in limb if f"{side}_{part}" in points]
            for a, b in pairwise(ends):
                cv2.line(mask, a, b, 255, thick)
    corners = ("left_shoulder", "right_shoulder", "right_hip", "left_hip")
    trunk = np.array([points[c] for c in corners if c in points], np.int32).reshape(-1, 2)
    if len(trunk) >= 2:
        cv2.polylines(mask, [trunk], True, 255, thick)
        cv2.fillConvexPoly(mask, cv2.convexHull(trunk), 255)
    face = [points[p] for p in ("nose", "left_ear", "right_ear", "head") if p in points]
    if face:
        x, y = np.mean(face, axis=0)
        cv2.circle(mask, (round(x), round(y)), round(HEAD * MASK_PX), 255, -1)
        shoulders = [points[c] for c in corners[:2] if c in points]
        for shoulder in shoulders:
            cv2.line(mask, (round(x), round(y)), shoulder, 255, max(2, thick // 2))


def _whole(values: Float[np.ndarray, "..."]) -> list[int]:
    return [round(v) for v in values.ravel().tolist()]


LONGEST_WHOLE = 3000  # of a video that is followed whole; of a longer one, its used frames


@dataclass
class TrackedOutlines:
    """The outlines of one video as JSON, or why there are none; neither while they are made."""

    document: bytes | None = None
    fault: str | None = None


class Tracks:
    """Outlines by key: a digest of what they are made from."""

    def __init__(self, thread: BackgroundThread) -> None:
        self._thread = thread
        self._outlines: dict[str, TrackedOutlines] = {}
        self._keys: dict[str, str] = {}  # by video

    def get(self, key: str) -> bytes | None:
        """The outlines of a key as JSON; None where there are none."""
        made = self._outlines.get(key)
        return None if made is None else made.document

    def update(self, action: Action, params: KeypointsParams, counts: dict[str, int]) -> None:
        """Follow everybody in the videos whose detections are there."""
        keys = {}
        for declared in action.videos:
            given = action.detected.get(declared.id) if declared.detected else declared.keypoints
            place = None if given is None else action.folder / given
            source = place if place is not None and place.exists() else None
            if source is None or (declared.video is not None and declared.id not in counts):
                continue
            whole = counts.get(declared.id, 0) <= LONGEST_WHOLE
            asked = declared.model_copy(
                update={"person": None, "frames": None if whole else declared.frames}
            )
            parts = asked.model_dump(mode="json", exclude={"id", "mirrored", "repetitions"})
            text = json.dumps([str(action.folder), str(source), source.stat().st_mtime_ns, parts])
            key = hashlib.sha256(text.encode()).hexdigest()[:24]
            keys[declared.id] = key
            if key not in self._outlines:
                self._outlines[key] = TrackedOutlines()
                self._thread.add(key, _follow(self._outlines[key], action, asked, source, params))
        self._keys = keys

    def state(self, video: str) -> dict[str, Any]:
        """Of a video, for the page: none, waiting, ready (with the key), or fault."""
        key = self._keys.get(video)
        if key is None:
            return {"state": "none"}
        made = self._outlines[key]
        if made.fault is not None:
            return {"state": "fault", "fault": made.fault}
        return {"state": "waiting"} if made.document is None else {"state": "ready", "key": key}


def _follow(
    made: TrackedOutlines, action: Action, asked: Declaration, source: Path, params: KeypointsParams
) -> Any:
    def job() -> None:
        from imocap_core.adapters.detected_people import followed_video

        video = None if asked.video is None else action.folder / asked.video
        try:
            followed = followed_video(asked, source, video, action.file, params, every_shot=True)
            document = json.dumps(outlines_of(followed.people), separators=(",", ":"))
        except (ValueError, OSError, MemoryError, ImocapError) as error:
            made.fault = str(error)
            return
        made.document = document.encode()

    return job
