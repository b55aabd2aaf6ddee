"""All videos in lock-step: each tile shows the frame that belongs to the same moment."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from imocap_core.artifacts.schemas import Keypoints, SyncSummary, VideoKeypoints
from imocap_core.figures.lettering import DIMMED, write, write_strip
from imocap_core.figures.sync_summary import common_moments, positions_on_axis, retimed, title_of
from imocap_core.film.performer import rgb_of, source_frames

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Image = NDArray[np.uint8]
Paint = Callable[[int, Image, Array], Image]
"""Paints over a part of the picture of a used frame, (3, 3) moving its pixels there."""

TILE_WIDTH_PX = 480
FILM_HEIGHT_PX = 1200  # of more rows of tiles, each is smaller
TALLEST, FLATTEST = 1.4, 0.8  # height of a tile, share of its width
MARGIN = 1.35  # of the performer's box
FOLLOW_S = 0.6  # the window follows the performer this slowly
GAP_PX = 6
FRAME_RGB = (24, 26, 29)


@dataclass(frozen=True)
class Track:
    """One video on the common time axis, a value each moment."""

    name: str
    rgb: tuple[int, int, int]
    file: Path | None
    size: tuple[int, int]  # width, height
    index: Ints  # (M,) of used frames, never going back
    frames: Ints  # (M,) their source frame numbers
    matched: NDArray[np.bool_]  # (M,)
    confidence: Array  # (M,)
    windows: Array  # (M, 4) x0 y0 width height of what is shown, pixels
    paint: Paint | None = None


def tracks_of(
    keypoints: Keypoints,
    sync: SyncSummary,
    files: Mapping[str, Path | None],
    paints: Mapping[str, Paint] | None = None,
) -> list[Track]:
    """The reference first, then the other videos named in `files`; None: there is no file.

    The moments are those of `common_moments`. paints: what is painted over some videos.
    """
    seen = {v.id: v for v in keypoints.videos}
    moments, fps = common_moments(keypoints, sync), seen[sync.reference].fps
    order = [sync.reference, *(i for i in sync.ids if i != sync.reference)]
    shown = [seen[i] for i in order if i in files]
    shape = tile_shape(shown)
    tracks = []
    for video in shown:
        found = next(m for m in sync.maps if m.id == video.id)
        index, matched = retimed(positions_on_axis(sync, video.id, fps), moments, fps)
        tracks.append(
            Track(
                name=title_of(sync, video.id),
                rgb=rgb_of(sync.ids, video.id),
                file=files[video.id],
                size=video.size,
                index=index,
                frames=video.frames[index],
                matched=matched,
                confidence=np.nan_to_num(found.confidence)[index],
                windows=crop_windows(video, shape)[index],
                paint=(paints or {}).get(video.id),
            )
        )
    return tracks


def tile_shape(videos: Sequence[VideoKeypoints]) -> tuple[int, int]:
    """Height and width of every tile, as the performers' boxes and the film's size ask for."""
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


def crop_windows(video: VideoKeypoints, shape: tuple[int, int]) -> Array:
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


def side_by_side(tracks: Sequence[Track], shape: tuple[int, int]) -> Iterator[Image]:
    """The frames of the film, one a moment; tiles of `shape` (height, width) in a grid."""
    if not tracks:
        raise ValueError("tracks: expected at least one video, got none")
    rows, columns = grid_shape(len(tracks))
    height, width = shape
    readers = [source_frames(track.file, track.frames, track.size) for track in tracks]
    for moment in range(len(tracks[0].frames)):
        film = np.full(
            (rows * (height + GAP_PX) - GAP_PX, columns * (width + GAP_PX) - GAP_PX, 3),
            FRAME_RGB,
            dtype=np.uint8,
        )
        for number, (track, reader) in enumerate(zip(tracks, readers, strict=True)):
            y, x = (height + GAP_PX) * (number // columns), (width + GAP_PX) * (number % columns)
            film[y : y + height, x : x + width] = tile(track, moment, next(reader), shape)
        yield film


def tile(track: Track, moment: int, picture: Image, shape: tuple[int, int]) -> Image:
    """One video at one moment: cut out, named, dimmed where nothing matches."""
    height, width = shape
    x, y, shown, _ = track.windows[moment]
    scale = width / shown
    move = np.array([[scale, 0, -x * scale], [0, scale, -y * scale]])
    smooth = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    if scale < 0.6:
        picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), 0.35 / scale), dtype=np.uint8)
    moved = cv2.warpAffine(picture, move, (width, height), flags=smooth, borderValue=FRAME_RGB)
    cut: Image = np.asarray(moved, dtype=np.uint8)
    if track.paint is not None:
        cut = track.paint(int(track.index[moment]), cut, np.vstack([move, [0, 0, 1]]))
    matched = bool(track.matched[moment])
    size = width / TILE_WIDTH_PX
    if not matched:
        cut = np.asarray(cut * DIMMED, dtype=np.uint8)
        write(cut, "unmatched", (width // 2, height // 2), 0.9 * size, before=0.5)
    said = f"frame {track.frames[moment]}" if matched else ""
    write_strip(cut, track.name, said, track.rgb, size)
    if matched:
        cut[-5:, : round(width * float(np.clip(track.confidence[moment], 0, 1)))] = track.rgb
    return cut


def _sides(video: VideoKeypoints) -> tuple[float, float]:
    """Width and height of the performer's box, as large as it usually gets."""
    boxes = _bridged(video.person_box_px, video.size)
    width, height = np.quantile(boxes[:, 2:] - boxes[:, :2], 0.95, axis=0)
    return max(float(width), 1.0), max(float(height), 1.0)


def _bridged(boxes: Array, size: tuple[int, int]) -> Array:
    """Boxes (T, 4), those missing between their neighbours in time; the picture if all are."""
    seen = np.flatnonzero(np.isfinite(boxes).all(axis=1))
    if not len(seen):
        return np.tile(np.array([0.0, 0.0, *size]), (len(boxes), 1))
    every = np.arange(len(boxes))
    return np.stack([np.interp(every, seen, boxes[seen, k]) for k in range(4)], axis=1)
