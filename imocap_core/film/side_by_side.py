"""All videos in lock-step: each tile shows the frame that belongs to the same moment."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import gaussian_filter1d

from imocap_core.artifacts.schemas import Keypoints, SyncSummary, VideoKeypoints
from imocap_core.figures.lettering import DIMMED, write, write_strip
from imocap_core.figures.sync_summary import common_moments, positions_on_axis, retimed, title_of
from imocap_core.film.overlay_body import Image, rgb_of, source_frames

Paint = Callable[[int, Image, Float[np.ndarray, "3 3"]], Image]
"""Paints over a part of the picture of a used frame; (3, 3): from its pixels to the part's."""

TILE_WIDTH_PX = 480
FILM_HEIGHT_PX = 1200  # of more rows of tiles, each is smaller
TALLEST, FLATTEST = 1.4, 0.8  # height of a tile, share of its width
MARGIN = 1.35  # of the performer's box
FOLLOW_S = 0.6  # the window follows the performer this slowly
GAP_PX = 6
FRAME_RGB = (24, 26, 29)


@dataclass(frozen=True)
class SyncedVideo:
    """One video on the common time axis, one value per moment.

    Attributes:
        name, rgb, file: its title, colour (0 to 255) and video file. size: width, height, pixels.
        index: (N,) positions among its used frames, never falling. frames: (N,) their source frame
            numbers. matched: (N,) whether the video shows the moment. confidence: (N,) 0 to 1.
        windows: (N, 4) x0 y0 width height of the part that is shown, pixels.
        paint: what is painted over it.
    """

    name: str
    rgb: tuple[int, int, int]
    file: Path | None
    size: tuple[int, int]
    index: Int[np.ndarray, " N"]
    frames: Int[np.ndarray, " N"]
    matched: Bool[np.ndarray, " N"]
    confidence: Float[np.ndarray, " N"]
    windows: Float[np.ndarray, "N 4"]
    paint: Paint | None = None


def synced_videos(
    keypoints: Keypoints,
    sync: SyncSummary,
    files: Mapping[str, Path | None],
    paints: Mapping[str, Paint] | None = None,
) -> list[SyncedVideo]:
    """The reference first, then the other videos named in `files` (None: there is no file).

    The moments are those of `common_moments`. paints: what is painted over some videos.
    """
    by_id = {v.id: v for v in keypoints.videos}
    moments, fps = common_moments(keypoints, sync), by_id[sync.reference].fps
    order = [sync.reference, *(i for i in sync.ids if i != sync.reference)]
    shown = [by_id[i] for i in order if i in files]
    shape = tile_shape(shown)
    videos = []
    for video in shown:
        matches = next(m for m in sync.maps if m.id == video.id)
        index, matched = retimed(positions_on_axis(sync, video.id, fps), moments, fps)
        videos.append(
            SyncedVideo(
                name=title_of(sync, video.id),
                rgb=rgb_of(sync.ids, video.id),
                file=files[video.id],
                size=video.size,
                index=index,
                frames=video.frames[index],
                matched=matched,
                confidence=np.nan_to_num(matches.confidence)[index],
                windows=crop_windows(video, shape)[index],
                paint=(paints or {}).get(video.id),
            )
        )
    return videos


def tile_shape(videos: Sequence[VideoKeypoints]) -> tuple[int, int]:
    """Height and width of every tile, by the performers' boxes and the film's size."""
    sides = [_sides(video) for video in videos]
    ratio = np.median([height / width for width, height in sides]) if sides else 1.0
    ratio = float(np.clip(ratio, FLATTEST, TALLEST))
    rows, _ = grid_shape(len(videos))
    height = min(ratio * TILE_WIDTH_PX, FILM_HEIGHT_PX / max(rows, 1) - GAP_PX)
    return 2 * int(height / 2), 2 * int(height / ratio / 2)


def grid_shape(count: int) -> tuple[int, int]:
    """Rows and columns of `count` tiles, at most four in a row."""
    rows = ceil(count / 4)
    return rows, ceil(count / max(rows, 1))


def crop_windows(video: VideoKeypoints, shape: tuple[int, int]) -> Float[np.ndarray, "T 4"]:
    """Windows (T, 4) x0 y0 width height in pixels, of one size and the tile's proportions, that
    follow the performer slowly and don't leave the picture where they fit in."""
    height, width = shape
    boxes = _bridged(video.person_box_px, video.size)
    needed = np.array(_sides(video)) * MARGIN
    scale = max(needed[0] / width, needed[1] / height)
    side = np.array([width, height]) * min(scale, max(np.array(video.size) / (width, height)))
    centre = (boxes[:, :2] + boxes[:, 2:]) / 2
    centre = gaussian_filter1d(centre, FOLLOW_S * video.fps, axis=0, mode="nearest")
    room = np.array(video.size) - side
    corner = np.where(room >= 0, np.clip(centre - side / 2, 0, np.maximum(room, 0)), room / 2)
    return np.concatenate([corner, np.broadcast_to(side, corner.shape)], axis=1)


def side_by_side(videos: Sequence[SyncedVideo], shape: tuple[int, int]) -> Iterator[Image]:
    """The frames of the film, one per moment; tiles of `shape` (height, width) in a grid."""
    if not videos:
        raise ValueError("videos: expected at least one, got none")
    rows, columns = grid_shape(len(videos))
    height, width = shape
    readers = [source_frames(video.file, video.frames, video.size) for video in videos]
    for moment in range(len(videos[0].frames)):
        film = np.full(
            (rows * (height + GAP_PX) - GAP_PX, columns * (width + GAP_PX) - GAP_PX, 3),
            FRAME_RGB,
            dtype=np.uint8,
        )
        for number, (video, reader) in enumerate(zip(videos, readers, strict=True)):
            y, x = (height + GAP_PX) * (number // columns), (width + GAP_PX) * (number % columns)
            film[y : y + height, x : x + width] = tile(video, moment, next(reader), shape)
        yield film


def tile(video: SyncedVideo, moment: int, picture: Image, shape: tuple[int, int]) -> Image:
    """One video at one moment: cropped, titled, dimmed where it is unmatched."""
    height, width = shape
    x, y, shown, _ = video.windows[moment]
    scale = width / shown
    move = np.array([[scale, 0, -x * scale], [0, scale, -y * scale]])
    smooth = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    if scale < 0.6:
        picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), 0.35 / scale), dtype=np.uint8)
    moved = cv2.warpAffine(picture, move, (width, height), flags=smooth, borderValue=FRAME_RGB)
    cut: Image = np.asarray(moved, dtype=np.uint8)
    if video.paint is not None:
        cut = video.paint(int(video.index[moment]), cut, np.vstack([move, [0, 0, 1]]))
    matched = bool(video.matched[moment])
    size = width / TILE_WIDTH_PX
    if not matched:
        cut = np.asarray(cut * DIMMED, dtype=np.uint8)
        write(cut, "unmatched", (width // 2, height // 2), 0.9 * size, before=0.5)
    caption = f"frame {video.frames[moment]}" if matched else ""
    write_strip(cut, video.name, caption, video.rgb, size)
    if matched:
        cut[-5:, : round(width * float(np.clip(video.confidence[moment], 0, 1)))] = video.rgb
    return cut


def _sides(video: VideoKeypoints) -> tuple[float, float]:
    """Width and height of the performer's box: their 95th percentiles."""
    boxes = _bridged(video.person_box_px, video.size)
    width, height = np.quantile(boxes[:, 2:] - boxes[:, :2], 0.95, axis=0)
    return max(float(width), 1.0), max(float(height), 1.0)


def _bridged(boxes: Float[np.ndarray, "T 4"], size: tuple[int, int]) -> Float[np.ndarray, "T 4"]:
    """Boxes (T, 4), those missing between their neighbours in time; the picture if all are."""
    visible = np.flatnonzero(np.isfinite(boxes).all(axis=1))
    if not len(visible):
        return np.tile(np.array([0.0, 0.0, *size]), (len(boxes), 1))
    every = np.arange(len(boxes))
    return np.stack([np.interp(every, visible, boxes[visible, k]) for k in range(4)], axis=1)
