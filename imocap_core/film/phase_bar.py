"""The frame of a film of several videos: its title above, the common time axis below."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float

from imocap_core.artifacts.schemas import Keypoints, SyncSummary
from imocap_core.figures.lettering import PALE, WHITE, write
from imocap_core.figures.sync_summary import common_moments
from imocap_core.film.overlay_body import Image
from imocap_core.film.side_by_side import (
    FRAME_RGB,
    Paint,
    SyncedVideo,
    side_by_side,
    synced_videos,
    tile_shape,
)

HEAD_PX, ROW_PX, ROW_GAP_PX, LABELS_PX = 46, 9, 4, 26
SIDE_PX = 16
UNSURE = 0.25  # brightness of a confidence of 0
EMPTY_RGB = (44, 47, 51)
TICKS = 8  # at most


def lock_step(
    keypoints: Keypoints,
    sync: SyncSummary,
    files: Mapping[str, Path | None],
    name: str,
    paints: Mapping[str, Paint] | None = None,
    every: int = 1,
) -> Iterator[Image]:
    """The film of an action: the videos named in `files` (None: there is no file) on the common
    time axis, a frame at each of `common_moments`, or at `every` so many of them; `paints`: what is
    painted over some videos."""
    fps = next(v.fps for v in keypoints.videos if v.id == sync.reference)
    videos = [thinned(video, every) for video in synced_videos(keypoints, sync, files, paints)]
    film = side_by_side(videos, tile_shape([v for v in keypoints.videos if v.id in files]))
    title = f"{name}: {len(videos)} videos on one time axis"
    return framed(film, videos, common_moments(keypoints, sync)[::every] / fps, title)


def thinned(video: SyncedVideo, every: int) -> SyncedVideo:
    """The video at every so many moments."""
    return replace(
        video,
        index=video.index[::every],
        frames=video.frames[::every],
        matched=video.matched[::every],
        confidence=video.confidence[::every],
        windows=video.windows[::every],
    )


def framed(
    film: Iterable[Image],
    videos: Sequence[SyncedVideo],
    moments_s: Float[np.ndarray, " N"],
    title: str,
) -> Iterator[Image]:
    """The film's frames with a title, the phase, and per video a row that shows where it matches.

    moments_s: (N,) seconds of the reference, one per frame. Rows are brighter where the
    confidence is higher; the line is the present moment. ValueError when the film has more frames
    than there are moments.
    """
    bar: Image | None = None
    for moment, picture in enumerate(film):
        if moment >= len(moments_s):
            raise ValueError(f"moments_s: expected one a frame of the film, got {len(moments_s)}")
        if bar is None:
            bar = phase_bar(videos, moments_s, picture.shape[1])
        head = np.full((HEAD_PX, picture.shape[1], 3), FRAME_RGB, dtype=np.uint8)
        write(head, title, (SIDE_PX, 31), 0.78)
        clock = f"{moments_s[moment]:.2f} s"
        write(head, clock, (picture.shape[1] - SIDE_PX, 31), 0.7, PALE, before=1.0)
        foot = bar.copy()
        x = int(_column(moments_s, moment, picture.shape[1]))
        cv2.line(foot, (x, 2), (x, foot.shape[0] - LABELS_PX), WHITE, 2, cv2.LINE_AA)
        yield np.concatenate([head, picture, foot])


def phase_bar(
    videos: Sequence[SyncedVideo], moments_s: Float[np.ndarray, " N"], width: int
) -> Image:
    """The time axis (height, width, 3): one row per video, and seconds below."""
    height = len(videos) * (ROW_PX + ROW_GAP_PX) + ROW_GAP_PX + LABELS_PX
    bar: Image = np.full((height + height % 2, width, 3), FRAME_RGB, dtype=np.uint8)
    for number, video in enumerate(videos):
        sure = UNSURE + (1 - UNSURE) * np.clip(video.confidence, 0, 1)
        lit = np.where(video.matched[:, None], sure[:, None] * video.rgb, EMPTY_RGB)
        row = np.rint(lit[None]).astype(np.uint8)
        wide = cv2.resize(row, (width - 2 * SIDE_PX, ROW_PX), interpolation=cv2.INTER_NEAREST)
        y = ROW_GAP_PX + number * (ROW_PX + ROW_GAP_PX)
        bar[y : y + ROW_PX, SIDE_PX : width - SIDE_PX] = wide
    for second in _ticks(moments_s):
        moment = float(np.interp(second, moments_s, np.arange(len(moments_s))))
        place = (round(_column(moments_s, moment, width)), bar.shape[0] - 8)
        write(bar, f"{second:g} s", place, 0.45, PALE, before=0.5)
    return bar


def _column(moments_s: Float[np.ndarray, " N"], moment: float, width: int) -> float:
    """Pixel column of a moment on the axis: the middle of its share of the row."""
    return SIDE_PX + (moment + 0.5) / len(moments_s) * (width - 2 * SIDE_PX)


def _ticks(moments_s: Float[np.ndarray, " N"]) -> list[float]:
    """Round seconds within, at most TICKS, none at the very ends."""
    lasting = float(moments_s[-1] - moments_s[0])
    step = next((s for s in (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30) if lasting / s <= TICKS), 60)
    edge = 0.03 * lasting
    first, last = np.ceil((moments_s[0] + edge) / step), np.floor((moments_s[-1] - edge) / step)
    return [round(float(k * step), 1) for k in np.arange(first, last + 1)]
