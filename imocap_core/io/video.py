"""Video files: properties, frames and sound one by one as shown, and H.264 out, by PyAV (FFmpeg).

How the stored pictures of a video are shown: with square pixels, then turned or reflected. A file
may say that its pixels are not square (tapes, DVDs) and how players place the picture (phones held
sideways, front cameras, a flip in an editor). Everything that follows works on the picture as it is
shown.

Pictures come as players show them (`display`), a slow-motion file's times as they were taken.
"""

from __future__ import annotations

import errno
import io
import os
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
from av.codec.codec import UnknownCodecError
from av.sidedata.sidedata import Type as SideData
from av.stream import Disposition
from av.video.reformatter import Colorspace
from av.video.stream import VideoStream
from jaxtyping import Float, Int, UInt8

from imocap_core.files import atomic_write
from imocap_core.limits import MAX_ELEMENTS, MAX_FPS, MAX_PIXELS, MAX_SIDE_PX, MIN_FPS

SQUARE = 0.01  # nearer to 1, an aspect ratio is that of square pixels in a rounded size
WIDEST = 5.0  # a pixel that is longer than this in one direction is a damaged header
UPRIGHT = ((1, 0), (0, 1))


@dataclass(frozen=True)
class PictureDisplay:
    """Attributes:
    stored: width and height of the pictures in the file, pixels.
    aspect: width of a stored pixel over its height.
    axes: rows of the signed permutation that takes stored directions (x right, y down) to shown
        ones.
    """

    stored: tuple[int, int]
    aspect: float = 1.0
    axes: tuple[tuple[int, int], tuple[int, int]] = UPRIGHT

    @property
    def square(self) -> tuple[int, int]:
        """Width and height of the stored picture with square pixels."""
        return max(1, round(self.aspect * self.stored[0])), self.stored[1]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the shown picture."""
        width, height = self.square
        return (height, width) if self.axes[0][0] == 0 else (width, height)

    @property
    def mirrored(self) -> bool:
        """Whether the shown picture is the mirror image of the stored one."""
        (a, b), (c, d) = self.axes
        return a * d - b * c < 0

    def shown(self, picture: UInt8[np.ndarray, "..."]) -> UInt8[np.ndarray, "..."]:
        """A picture with square pixels as it is shown."""
        (a, b), (c, d) = self.axes
        if a == 0:
            picture = np.swapaxes(picture, 0, 1)
        picture = picture[:: c + d, :: a + b]
        return np.ascontiguousarray(picture)

    def shown_points(self, stored_px: Float[np.ndarray, "*any 2"]) -> Float[np.ndarray, "*any 2"]:
        """Pixels of the shown picture from those of the stored one."""
        middle = 0.5 * (np.array(self.stored) - 1)
        square = (stored_px - middle) * np.divide(self.square, self.stored)
        return square @ np.array(self.axes, float).T + 0.5 * (np.array(self.size) - 1)


@dataclass(frozen=True)
class ShownFrame:
    """A decoded frame and how it is shown."""

    frame: av.VideoFrame
    display: PictureDisplay

    def rgb(self) -> UInt8[np.ndarray, "height width 3"]:
        """The picture in its full size."""
        width, height = self.display.square
        if (self.frame.width, self.frame.height) == (width, height):
            return self.display.shown(np.asarray(self.frame.to_ndarray(format="rgb24"), np.uint8))
        return self.small("rgb24", 1.0)

    def small(self, format: str, scale: float) -> UInt8[np.ndarray, "..."]:
        """The picture resized by ``scale``: `gray` or `rgb24`."""
        width, height = (max(1, round(scale * side)) for side in self.display.square)
        small = self.frame.reformat(width=width, height=height, format=format, interpolation="AREA")
        return self.display.shown(np.asarray(small.to_ndarray(), np.uint8))


def display_of(frame: av.VideoFrame, aspect: float | None) -> PictureDisplay:
    """How a file's frames are shown; ``aspect``: of a stored pixel, None where it is not said."""
    stored = (frame.width, frame.height)
    side_data: Any = frame.side_data  # its types say less than it takes
    matrix = side_data.get(SideData.DISPLAYMATRIX)
    axes = UPRIGHT
    if matrix is not None:
        axes = axes_of(np.frombuffer(bytes(matrix), np.int32, 9).reshape(3, 3))
    if aspect is None or not 1 / WIDEST <= aspect <= WIDEST or abs(aspect - 1) < SQUARE:
        aspect = 1.0  # of square pixels in a rounded size, and for nonsense
    return PictureDisplay(stored, aspect, axes)


def axes_of(
    matrix: Int[np.ndarray, "3 3"] | Sequence[Sequence[int]],
) -> tuple[tuple[int, int], tuple[int, int]]:
    """The signed permutation nearest to a display matrix, which maps rows [x y 1]."""
    linear = np.array(matrix, float)[:2, :2].T
    if abs(linear[0, 0] * linear[1, 1]) >= abs(linear[0, 1] * linear[1, 0]):
        return (_sign(linear[0, 0]), 0), (0, _sign(linear[1, 1]))
    return (0, _sign(linear[0, 1])), (_sign(linear[1, 0]), 0)


def _sign(value: float) -> int:
    return -1 if value < 0 else 1


RgbPicture = UInt8[np.ndarray, "height width 3"]
ENCODER = "IMOCAP_ENCODER"
ENCODERS: dict[str, dict[str, str]] = {  # best first; x264 is GPL, libvpx is not
    "libx264": {},
    "libvpx-vp9": {"b:v": "0", "deadline": "good", "cpu-used": "5"},
}
_WEBM_ENCODER, WEBM_FPS = "libvpx-vp9", 25
GrayPicture = UInt8[np.ndarray, "height width"]
# FFmpeg's demuxers of files that hold a video or sound themselves. Playlists, scripts and picture
# sequences (hls, concat, dash, image2) name other files and are not opened.
CONTAINERS = (
    "aac,amv,apng,asf,av1,avi,avs2,avs3,cavsvideo,dhav,dirac,dnxhd,dv,evc,flac,flic,flv,gif,gxf,"
    "h261,h263,h264,hevc,ipu,ivf,lmlm4,m4v,matroska,mjpeg,mjpeg_2000,mov,mp3,mpeg,mpegts,"
    "mpegtsraw,mpegvideo,mxf,nsv,nut,nuv,obu,ogg,rm,swf,vc1,vc1test,vvc,wav,webp,wtv,yuv4mpegpipe"
)
# Titles in other encodings: PyAV below 19 refuses them unless told to replace; 19 replaces them.
_OLD = int(av.__version__.split(".")[0]) < 19
ANY_TITLES: dict[str, Any] = {"metadata_errors": "replace"} if _OLD else {}
ALONE = {"format_whitelist": CONTAINERS, "protocol_whitelist": "file"}
CAPTURE_RATE = "com.android.capture.fps"  # frames a second that an Android phone took
SLOWED = 1.5  # times, that stamps and camera must differ: less is a rate that varies


@dataclass(frozen=True)
class VideoInfo:
    """Attributes:
    fps: frames a second as they were taken.
    size: width and height of the picture as shown.
    slowed: how many times slower than taken the file's stamps play it.
    display: how the stored picture is shown; None where there is no file.
    """

    fps: float
    size: tuple[int, int]
    frame_count: int
    slowed: float = 1.0
    display: PictureDisplay | None = None

    def taken_at(self, fps: float) -> VideoInfo:
        """The same with another rate of the camera."""
        return replace(self, fps=fps, slowed=self.slowed * fps / self.fps)


def probe(path: Path) -> VideoInfo:
    """Frame rate, size and frame count of a video file. ValueError when it cannot be read."""
    with open_video(path) as container:
        stream = video_stream(container, path)
        rate = stream.average_rate or stream.guessed_rate
        if not rate:
            raise ValueError(f"{path}: no frame rate; convert it to a constant frame rate first")
        if not MIN_FPS <= rate <= MAX_FPS:
            raise ValueError(
                f"{path}: expected {MIN_FPS} to {MAX_FPS:,.0f} frames a second, it says "
                f"{float(rate):g}; convert it to a constant frame rate first"
            )
        first = next(decoded_frames(container, stream, path), None)
        if first is None:
            raise ValueError(f"{path}: no frames; expected a video, got an empty stream")
        count, taken = stream.frames, _camera_rate(container, stream, float(rate))
    if not 0 < count == _packet_count(path):  # a wrong header, or a clip trimmed by an edit list
        count = sum(1 for _ in read_gray(path, scale=0.05))
    display = first.display
    return VideoInfo(float(rate), display.size, count, display=display).taken_at(taken)


def read_rgb(
    path: Path, first: int = 0, stop: int | None = None
) -> Iterator[tuple[int, RgbPicture]]:
    """(frame number, RGB picture) for frames first to stop - 1, in order.

    ValueError when the file cannot be read.
    """
    for number, frame in _frames(path, first, stop):
        yield number, frame.rgb()


def read_rgb_of(path: Path, numbers: Collection[int]) -> Iterator[tuple[int, RgbPicture]]:
    """(frame number, RGB picture) of some frames, in order; the others are decoded only."""
    first, last = min(numbers, default=0), max(numbers, default=-1)
    for number, frame in _frames(path, first, last + 1):
        if number in numbers:
            yield number, frame.rgb()


def read_gray(
    path: Path,
    first: int = 0,
    stop: int | None = None,
    *,
    scale: float = 1.0,
    damaged: bool = False,
) -> Iterator[tuple[int, GrayPicture]]:
    """(frame number, grey picture) for frames first to stop - 1, resized by ``scale``.

    The picture is (round(scale * height), round(scale * width)). damaged: decode in one thread,
    because what several threads fill in for lost data differs from run to run.
    ValueError when the file cannot be read.
    """
    for number, frame in _frames(path, first, stop, one_thread=damaged):
        yield number, frame.small("gray", scale)


def read_checked_gray(
    path: Path, first: int = 0, stop: int | None = None, *, scale: float = 1.0
) -> Iterator[tuple[int, GrayPicture, bool]]:
    """As `read_gray`, with whether the decoder met no error in the frame: what it could not decode
    it fills in from the frames before. In one thread: several lose an error now and then."""
    for number, frame in _frames(path, first, stop, one_thread=True):
        yield number, frame.small("gray", scale), not frame.frame.is_corrupt


def film_encoder() -> str:
    """The encoder of films: the one that IMOCAP_ENCODER names, else the first that FFmpeg has.

    ValueError when there is none, or it is unknown.
    """
    names = [os.environ[ENCODER]] if os.environ.get(ENCODER) else list(ENCODERS)
    for name in names:
        with suppress(av.FFmpegError, ValueError):
            if name in ENCODERS and av.Codec(name, "w"):
                return name
    raise ValueError(
        f"no film can be encoded: expected one of {', '.join(ENCODERS)}, {', '.join(names)} is not "
        f"in this build of FFmpeg; check {ENCODER}"
    )


def write_h264(
    path: Path, frames: Iterable[RgbPicture], fps: float, *, crf: int = 20, faststart: bool = False
) -> int:
    """Write RGB frames as an mp4 (H.264, or what `film_encoder` is); returns their number.

    One thread and no encoder stamps: the same frames give the same bytes, as far as x264 does: in
    pictures of a megapixel its rate control (mbtree) reads memory that it has not set, and one film
    in some differs by a few grey levels; in pictures of 640 x 480 none did. Odd sizes lose their
    last row or column, as H.264 in 4:2:0 needs even sizes. faststart: the index comes first, so
    that a browser plays while it loads. ValueError when there is no frame.
    """
    count = 0
    options = {"fflags": "+bitexact", **({"movflags": "+faststart"} if faststart else {})}
    with (
        atomic_write(path) as draft,
        av.open(str(draft), "w", format="mp4", options=options) as container,
    ):
        encoder = film_encoder()
        stream: Any = container.add_stream(encoder, rate=Fraction(fps).limit_denominator(1001))
        stream.pix_fmt = "yuv420p"
        speed = {"preset": "veryfast"} if encoder == "libx264" else ENCODERS[encoder]
        stream.options = {"crf": str(crf), "threads": "1", "flags": "+bitexact", **speed}
        for picture in frames:
            if count == 0:
                stream.height, stream.width = (2 * (side // 2) for side in picture.shape[:2])
            even = np.ascontiguousarray(picture[: stream.height, : stream.width])
            container.mux(stream.encode(av.VideoFrame.from_ndarray(even, format="rgb24")))
            count += 1
        if count == 0:
            raise ValueError(f"{path}: expected at least one frame to write, got none")
        container.mux(stream.encode())
    return count


@dataclass(frozen=True)
class WebmStream:
    """VP9 pictures in WebM, whose packets are also found one by one.

    Attributes:
    content: the file, whose pictures are 1 / `WEBM_FPS` s apart.
    packets: the first byte of each picture's packet and its length, one packet a picture.
    keys: whether each picture is decoded without those before it.
    """

    content: bytes
    size: tuple[int, int]
    packets: list[tuple[int, int]]
    keys: list[bool]


def encode_webm(pictures: Iterable[RgbPicture], *, crf: int, key_every: int) -> WebmStream:
    """RGB pictures of one size as VP9, each decoded from the ones before it since a key picture.

    Odd sizes lose their last row or column. One thread, no stamps: the same pictures give the same
    bytes. ValueError when there is no picture, or no such encoder.
    """
    target, size = io.BytesIO(), (0, 0)
    speed = {"b:v": "0", "deadline": "realtime", "cpu-used": "7", "lag-in-frames": "0"}
    options = {"crf": str(crf), "g": str(key_every), "threads": "1", "flags": "+bitexact", **speed}
    try:
        with av.open(target, "w", format="webm", options={"fflags": "+bitexact"}) as container:
            stream: Any = container.add_stream(_WEBM_ENCODER, rate=WEBM_FPS, options=options)
            stream.pix_fmt, stream.colorspace = "yuv420p", Colorspace.ITU601
            for picture in pictures:
                if size == (0, 0):
                    size = (picture.shape[1] // 2 * 2, picture.shape[0] // 2 * 2)
                    stream.width, stream.height = size
                even = np.ascontiguousarray(picture[: size[1], : size[0]])
                container.mux(stream.encode(av.VideoFrame.from_ndarray(even, format="rgb24")))
            if size == (0, 0):
                raise ValueError("pictures: expected at least one, got none")
            container.mux(stream.encode())
    except (av.FFmpegError, UnknownCodecError) as error:
        raise ValueError(f"pictures cannot be encoded with {_WEBM_ENCODER}: {error}") from None
    content, packets, keys, after = target.getvalue(), [], [], 0
    with av.open(io.BytesIO(content), "r") as film:
        for packet in film.demux(video=0):
            if packet.size:
                start = content.index(bytes(packet), after)
                after = start + packet.size
                packets.append((start, packet.size))
                keys.append(bool(packet.is_keyframe))
    return WebmStream(content, size, packets, keys)


def open_video(path: Path) -> Any:
    """A video file's container, one of `CONTAINERS`. ValueError when it is none."""
    if not path.is_file():
        fault = "is a folder, not a video" if path.is_dir() else "no such video file"
        raise ValueError(f"{path}: {fault}; check `video` in action.yaml")
    try:
        return av.open(f"file:{path}", options=dict(ALONE), **ANY_TITLES)
    except (av.FFmpegError, OSError) as error:
        if error.errno == errno.EINVAL:  # of FFmpeg for what is not among `CONTAINERS`
            raise ValueError(
                f"{path}: expected a video, got a picture, a playlist or another file without a "
                f"video of its own; give the video file"
            ) from None
        raise ValueError(
            f"{path}: is not a readable video ({error.strerror}); re-encode it"
        ) from None


def video_stream(container: Any, path: Path) -> VideoStream:
    """The video stream that players show. ValueError where there is none that can be decoded."""
    streams = [s for s in container.streams.video if not s.disposition & Disposition.attached_pic]
    if not streams:
        raise ValueError(f"{path}: no video stream; expected a video, got audio or data only")
    best = container.streams.best("video")
    stream: VideoStream = best if best in streams else streams[0]
    stream.thread_type = "AUTO"
    if stream.codec_context is None:
        raise ValueError(f"{path}: its kind of compression cannot be decoded; re-encode it")
    width, height = stream.width, stream.height
    if max(width, height) > MAX_SIDE_PX or width * height > MAX_PIXELS:
        raise ValueError(
            f"{path}: expected pictures of at most {MAX_PIXELS:,} pixels, it says "
            f"{width} x {height}; re-encode it"
        )
    return stream


def decoded_frames(container: Any, stream: VideoStream, path: Path) -> Iterator[ShownFrame]:
    """Its frames, in the order in which they are shown, all of the first one's size. ValueError
    where decoding fails."""
    count, display, aspect = 0, None, stream.sample_aspect_ratio
    try:
        for frame in container.decode(stream):
            count += 1
            display = display or display_of(frame, None if aspect is None else float(aspect))
            yield ShownFrame(frame, display)
    except (av.FFmpegError, OSError) as error:
        raise ValueError(
            f"{path}: broken, decoding failed after {count} frames ({error.strerror}); re-encode it"
        ) from None


def _packet_count(path: Path) -> int:
    """Frames that are shown, by the file's packets. ValueError where its index goes beyond it."""
    with open_video(path) as container:
        stream = video_stream(container, path)
        ends = [e.pos + e.size for e in getattr(stream, "index_entries", None) or ()]
        present = sum(end <= path.stat().st_size for end in ends)
        if present < len(ends):
            raise ValueError(
                f"{path}: cut short, {present} of its {len(ends)} frames are in the file; copy or "
                f"download it again"
            )
        with suppress(av.FFmpegError, OSError):
            return sum(p.size > 0 and not p.is_discard for p in container.demux(stream))
    return 0


def _frames(
    path: Path, first: int, stop: int | None, *, one_thread: bool = False
) -> Iterator[tuple[int, ShownFrame]]:
    """Frames are counted while decoding: seeking is not exact in every format."""
    with open_video(path) as container:
        stream = video_stream(container, path)
        if one_thread:
            stream.thread_count = 1
        for number, frame in enumerate(decoded_frames(container, stream, path)):
            if stop is not None and number >= stop:
                return
            if number >= first:
                yield number, frame


def _camera_rate(container: Any, stream: VideoStream, stamped: float) -> float:
    """Frames a second that the camera took: those of the stamps, unless a phone says that it took
    others, for slow motion or a time lapse. Such a film has no sound."""
    tags = {**stream.metadata, **container.metadata}
    given = {name.lower(): text for name, text in tags.items()}  # Matroska has capitals
    try:
        taken = float(given.get(CAPTURE_RATE) or stamped)
    except ValueError:
        return stamped
    differs = max(taken / stamped, stamped / max(taken, MIN_FPS)) >= SLOWED
    fits = MIN_FPS <= taken <= MAX_FPS and not container.streams.audio
    return taken if differs and fits else stamped


def read_sound(path: Path, rate_hz: float) -> Float[np.ndarray, " N"] | None:
    """Samples from the moment of the first picture on, all channels in one; None without a sound
    track. ValueError when the file cannot be read."""
    with open_video(path) as container:
        if not container.streams.audio:
            return None
        first_s = _first_picture_s(path)
        resampler = av.AudioResampler(format="flt", layout="mono", rate=round(rate_hz))
        parts: list[np.ndarray] = []
        start_s, count = None, 0
        with suppress(av.FFmpegError, OSError):  # what was decoded until then
            for frame in container.decode(container.streams.audio[0]):
                start_s = (frame.time or 0.0) if start_s is None else start_s
                parts += [part.to_ndarray()[0] for part in resampler.resample(frame)]
                count += frame.samples
                if count > MAX_ELEMENTS:
                    raise ValueError(f"{path}: its sound is too long; use a shorter clip")
            parts += [part.to_ndarray()[0] for part in resampler.resample(None)]
    if not parts or start_s is None:
        return None
    samples = np.concatenate(parts).astype(np.float64)
    shift = round((start_s - first_s) * rate_hz)
    return np.concatenate([np.zeros(max(shift, 0)), samples[max(-shift, 0) :]])


def _first_picture_s(path: Path) -> float:
    with open_video(path) as container:
        stream = video_stream(container, path)
        stamps = [
            p.pts
            for p, _ in zip(container.demux(stream), range(32), strict=False)
            if p.pts is not None
        ]
        return float(max(min(stamps, default=0), 0) * (stream.time_base or 0))
