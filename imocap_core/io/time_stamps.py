"""Presentation time stamps of a video file's frames (PyAV)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import av
import numpy as np
from jaxtyping import Float

from imocap_core.frame_times import is_constant_rate, typical_step_s
from imocap_core.io.video import VideoInfo, decoded_frames, open_video, video_stream
from imocap_core.limits import MAX_FPS, MAX_FRAMES, MIN_FPS


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
