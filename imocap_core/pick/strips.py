"""A video looked through once for its strip: thumbnails, cuts between shots, and time stamps."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from imocap_core.io.frame_access import FrameStamps, all_frames
from imocap_core.io.video import probe
from imocap_core.people.shots import find_cuts

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


def strip_of(path: Path, progress: Callable[[float], None]) -> Strip:
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
