"""The sound of a video file, as samples of one channel."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import av
import numpy as np
from jaxtyping import Float

from imocap_core.io.video import open_video, video_stream
from imocap_core.limits import MAX_ELEMENTS


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
