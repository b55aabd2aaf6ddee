"""Small videos of every kind that people have, also of frames at chosen times, written by PyAV."""

import struct
from collections.abc import Iterable, Sequence
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

FPS = 25
PIXELS = {"gif": "rgb8", "mjpeg": "yuvj420p"}  # of other encoders yuv420p
TURNED = struct.pack(">9i", 0, 1 << 16, 0, -(1 << 16), 0, 0, 0, 0, 1 << 30)  # by a quarter


def level(number: int) -> int:
    """Grey level of a frame's left half; the right half is black."""
    return 40 + 12 * (number % 16)


def write_video(
    path: Path,
    codec: str = "libx264",
    count: int = 10,
    *,
    size: tuple[int, int] = (96, 64),
    first_pts: int = 0,
    audio: str | None = None,
    options: dict[str, str] | None = None,
    aspect: Fraction | None = None,
    matrix: Sequence[int] | None = None,
    rate: Fraction | int = FPS,
    metadata: dict[str, str] | None = None,
) -> Path:
    """A film whose frames tell their numbers. Skips the test where FFmpeg has no such encoder.

    first_pts: of the first frame; those before 0 are not shown. audio: encoder of a second of
    silence. aspect: width of a pixel over its height. matrix: nine numbers of a display matrix;
    then the upper quarter is black.
    """
    width, height = size
    try:
        av.Codec(codec, "w")
    except ValueError:
        pytest.skip(f"this build of FFmpeg has no encoder {codec}")
    with av.open(str(path), "w", options=options or {}) as container:
        container.metadata.update(metadata or {})
        stream = container.add_stream(codec, rate=rate)
        stream.width, stream.height = size
        stream.pix_fmt = PIXELS.get(codec, "yuv420p")
        stream.options = {"g": "5"}
        if aspect is not None:
            stream.sample_aspect_ratio = aspect
        if matrix is not None:
            stream.set_display_matrix(matrix)
        sound = None if audio is None else container.add_stream(audio, rate=48_000)
        for number in range(count):
            picture = np.zeros((height, width, 3), np.uint8)
            picture[:, : width // 2] = level(number)
            if matrix is not None:
                picture[: height // 4] = 0
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
            frame.pts = first_pts + number
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
        if sound is not None:
            silence = av.AudioFrame.from_ndarray(np.zeros((1, 48_000), np.float32), "fltp", "mono")
            silence.rate = 48_000
            container.mux(sound.encode(silence))
            container.mux(sound.encode())
    return path


def turn(path: Path) -> None:
    """Store beside the pictures of an mp4 that they are to be turned by a quarter."""
    content = bytearray(path.read_bytes())
    matrix = content.index(b"tkhd") + 4 + 40
    content[matrix : matrix + len(TURNED)] = TURNED
    path.write_bytes(content)


def write_timed(
    path: Path,
    times_s: Iterable[float],
    size: tuple[int, int] = (64, 48),
    *,
    rate: int = 30,
    ticks: int = 90_000,
) -> Path:
    """A film of flat pictures at increasing times; `rate` is what its header guesses."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=rate)
        stream.width, stream.height = size
        stream.pix_fmt = "yuv420p"
        stream.codec_context.time_base = Fraction(1, ticks)
        for number, time in enumerate(times_s):
            picture = np.full((size[1], size[0], 3), 16 + number % 200, np.uint8)
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
            frame.pts, frame.time_base = round(time * ticks), Fraction(1, ticks)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path
