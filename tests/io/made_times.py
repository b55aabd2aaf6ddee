"""Videos whose frames are shown at chosen times."""

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path

import av
import numpy as np


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
