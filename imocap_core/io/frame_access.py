"""Frames of a video: any by its number, ahead of their consumer, their time stamps; checks."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Generator, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar, cast

import av
import numpy as np
from jaxtyping import Float, UInt8

from imocap_core.io.video import (
    ShownFrame,
    VideoInfo,
    decoded_frames,
    open_video,
    probe,
    read_gray,
    video_stream,
)
from imocap_core.limits import LEAST_FRAMES, MAX_FPS, MAX_FRAMES, MIN_FPS
from imocap_core.sequences import is_constant_rate, typical_step_s


def variable_times_s(path: Path, info: VideoInfo) -> Float[np.ndarray, " T"] | None:
    """When every frame was taken, seconds after the first; None where the rate is constant.

    A file without usable stamps (missing, or repeated) counts as one of constant rate. ValueError
    when the file cannot be read, or its stamps are no video's.
    """
    times = _times_s(_packet_stamps(path), info)
    if times is None or is_constant_rate(times, info.fps):
        return None
    exact = _times_s(_frame_stamps(path), info)  # packets may be of other frames
    if exact is not None:
        times = exact
    if is_constant_rate(times, info.fps):
        return None
    fps = 1 / typical_step_s(times)
    duration_s = times[-1] - times[0]
    if not MIN_FPS <= fps <= MAX_FPS or duration_s * fps > max(MAX_FRAMES, 2 * len(times)):
        raise ValueError(
            f"{path}: its time stamps spread {len(times)} frames over {duration_s:,.0f} s, most of "
            f"them {1 / fps:.3g} s apart; convert it to a constant frame rate first"
        )
    return times - times[0]


def _times_s(stamps: Iterator[float | None], info: VideoInfo) -> Float[np.ndarray, " T"] | None:
    """The stamps in their order in time, at the speed of the action; None unless there is one for
    each frame and all differ."""
    given = list(stamps)
    if len(given) != info.frame_count or len(given) < 3 or None in given:
        return None
    times = np.sort(np.array(given, float)) / info.slowed
    return times if np.isfinite(times).all() and (np.diff(times) > 0).all() else None


def _packet_stamps(path: Path) -> Iterator[float | None]:
    """Stamps of the packets that are shown: nothing is decoded."""
    with open_video(path) as container:
        stream = video_stream(container, path)
        with suppress(av.FFmpegError, OSError):  # what is decoded of a broken file has its count
            for packet in container.demux(stream):
                if packet.size and not packet.is_discard:
                    yield None if packet.pts is None else float(packet.pts * stream.time_base)


def _frame_stamps(path: Path) -> Iterator[float | None]:
    """Stamps of the frames that can be decoded: of a broken file the first ones may be used."""
    with open_video(path) as container, suppress(ValueError):
        for frame in decoded_frames(container, video_stream(container, path), path):
            yield frame.frame.time


NEAR = 48  # frames ahead that are decoded one by one rather than sought


@dataclass(frozen=True)
class DecodedFrame:
    """Frame `number` of a video; `stamp`: its presentation time in the stream's own units."""

    number: int
    stamp: int | None
    is_key: bool
    frame: ShownFrame

    def rgb(self, side_px: int) -> UInt8[np.ndarray, "height width 3"]:
        """The picture as shown, reduced so that its larger side is at most `side_px`."""
        return self._picture("rgb24", side_px)

    def gray(self, side_px: int) -> UInt8[np.ndarray, "height width"]:
        """The same, grey."""
        return self._picture("gray", side_px)

    def _picture(self, format: str, side_px: int) -> UInt8[np.ndarray, "..."]:
        return self.frame.small(format, min(1.0, side_px / max(self.frame.display.size)))


def all_frames(path: Path) -> Iterator[DecodedFrame]:
    """Every frame of a video, in the order in which they are shown. ValueError when it cannot be
    read."""
    with open_video(path) as container:
        stream = video_stream(container, path)
        for number, shown in enumerate(decoded_frames(container, stream, path)):
            yield _numbered(number, shown)


def _numbered(number: int, shown: ShownFrame) -> DecodedFrame:
    return DecodedFrame(number, shown.frame.pts, bool(shown.frame.key_frame), shown)


@dataclass(frozen=True)
class FrameStamps:
    """Time stamps of all frames of a video, and the numbers of its key frames."""

    stamps: Sequence[int | None]
    key_frames: Sequence[int]

    @cached_property
    def numbers(self) -> dict[int, int] | None:
        """Stamp -> number; None, and nothing can be sought, where some are missing or repeated."""
        numbers = {stamp: n for n, stamp in enumerate(self.stamps) if stamp is not None}
        return numbers if len(numbers) == len(self.stamps) else None

    def key_before(self, number: int) -> int:
        """The last key frame that is not after a frame; 0 when there is none."""
        place = bisect_right(self.key_frames, number)
        return self.key_frames[place - 1] if place else 0


class FrameReader:
    """An open video from which frames are taken by number; not for several threads at once."""

    def __init__(self, path: Path, stamps: FrameStamps) -> None:
        self._path, self._stamps = path, stamps
        self._container: Any = None
        self._frames: Iterator[DecodedFrame] = iter(())
        self._next = 0

    def frames(self, first: int, last: int) -> Iterator[DecodedFrame]:
        """Frames first to last. ValueError when they cannot be read."""
        if self._container is None or not self._next <= first <= self._next + NEAR:
            self._seek(first)
        for decoded in self._frames:
            self._next = decoded.number + 1
            if decoded.number >= first:
                yield decoded
            if decoded.number >= last:
                return
        self.close()

    def close(self) -> None:
        """Close the file; the next frame opens it again."""
        if self._container is not None:
            self._frames = iter(())
            self._container.close()
            self._container = None

    def _seek(self, number: int) -> None:
        """Continue with a frame at or before `number`."""
        self.close()
        key = self._stamps.key_before(number)
        if key and self._stamps.numbers is not None and self._begin_at(key, number):
            return
        self._open(None)

    def _begin_at(self, key: int, number: int) -> bool:
        """Whether decoding from a key frame's time stamp begins at or before `number`."""
        self._open(key)
        first = next(self._frames, None)
        if first is None or first.number > number:
            self.close()
            return False
        rest = self._frames
        self._frames = (frame for frames in ((first,), rest) for frame in frames)
        self._next = first.number
        return True

    def _open(self, key: int | None) -> None:
        self._container = open_video(self._path)
        stream = video_stream(self._container, self._path)
        if key is not None:
            self._container.seek(self._stamps.stamps[key], stream=stream)
        frames = decoded_frames(self._container, stream, self._path)
        numbers = self._stamps.numbers
        counted: Iterable[tuple[int, ShownFrame]] = enumerate(frames)
        if key is not None and numbers is not None:
            counted = ((numbers[f.frame.pts], f) for f in frames if f.frame.pts in numbers)
        self._frames = (_numbered(number, shown) for number, shown in counted)
        self._next = 0


Item = TypeVar("Item")


AHEAD = 4  # items of `prefetch` that wait


def prefetch(items: Iterable[Item]) -> Generator[Item]:
    """The same items in the same order, computed in a thread, at most `AHEAD` of them waiting.

    An error in computing an item is raised here, after the items before it. When the generator is
    closed, the thread ends before its next item.
    """
    source, end = iter(items), object()
    pool = ThreadPoolExecutor(1)
    try:
        waiting = deque(pool.submit(next, source, end) for _ in range(AHEAD))
        while (item := waiting.popleft().result()) is not end:
            waiting.append(pool.submit(next, source, end))
            yield cast("Item", item)
    finally:
        pool.shutdown(cancel_futures=True)


BEGINNING_BYTES = 1024
FASTEST_FPS = 1000.0  # of a film of a person; above it the stamps are wrong
LOOK_SCALE = 0.05  # of the pictures, which are decoded only to see whether they can be
PICTURE, TEXT = "a picture", "text"
PICTURE_BEGINNINGS = (b"\xff\xd8\xff", b"\x89PNG", b"BM", b"II*\0", b"MM\0*")


def check_video(path: Path) -> VideoInfo:
    """Frame rate, size and frame count of a video that has a motion.

    ValueError for a file that is empty, text, a picture, audio, cut short, of another kind than
    video, of wrong time stamps, or of fewer than LEAST_FRAMES frames.
    """
    other = _other_kind(path)
    if other is not None:
        raise ValueError(f"{path}: expected a video, got {other}")
    info = probe(path)
    if info.fps > FASTEST_FPS:
        raise ValueError(
            f"{path}: its time stamps say {info.fps:,.0f} frames a second; convert it to its true "
            f"frame rate first"
        )
    if info.frame_count < LEAST_FRAMES:
        raise ValueError(
            f"{path}: expected at least {LEAST_FRAMES} frames, as fewer have no motion, got "
            f"{info.frame_count}; give a longer clip"
        )
    return info


def decode_whole(video: Path) -> None:
    """Decode a video to its end: a second for some hundred pictures. ValueError where it breaks
    off."""
    deque(read_gray(video, scale=LOOK_SCALE), maxlen=0)


def why_not_detected(video: Path) -> str:
    """Why the detector passed a video over."""
    try:
        decode_whole(video)
    except ValueError as error:
        return str(error)
    return f"{video}: it has no detections; run again"


def _other_kind(path: Path) -> str | None:
    """What a file is by its first bytes, with what to do; None for what may be a video."""
    if not path.is_file():
        return None
    with path.open("rb") as file:
        beginning = file.read(BEGINNING_BYTES)
    if not beginning:
        return "an empty file; copy or download it again"
    if _is_text(beginning):
        return TEXT
    try:
        open_video(path).close()
    except ValueError:
        if beginning.startswith(PICTURE_BEGINNINGS):
            return PICTURE
        if beginning[4:8] == b"ftyp":
            return "one cut short: the index at its end is missing; copy or download it again"
        raise
    return None


def _is_text(beginning: bytes) -> bool:
    """Whether bytes are UTF-8 without control characters; a character may be cut at the end."""
    try:
        text = beginning.decode("utf-8", errors="strict")
    except UnicodeDecodeError as error:
        if error.start < len(beginning) - 3:
            return False
        text = beginning[: error.start].decode()
    return all(letter.isprintable() or letter in "\t\r\n\f" for letter in text)
