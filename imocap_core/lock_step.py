"""All videos of an action in lock-step: a picture of each at every moment of the common time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from scipy.ndimage import gaussian_filter1d

from imocap_core.artifacts.schemas import Keypoints, SyncSummary, VideoKeypoints
from imocap_core.camera.background import filled_boxes
from imocap_core.figures.style import DIMMED, WHITE, rgb_of, write, write_strip
from imocap_core.figures.style import PALE as PALE_TEXT
from imocap_core.figures.sync_summary import common_moments, positions_on_axis, retimed, title_of
from imocap_core.io.video import read_rgb

Image = UInt8[np.ndarray, "_ _ 3"]
RGB = tuple[int, int, int]
NEUTRAL_RGB = (52, 56, 61)  # where there is no video


def source_frames(
    file: Path | None, frames: Int[np.ndarray, " T"], size: tuple[int, int]
) -> Iterator[Image]:
    """The pictures of source frames that never go back, decoded once; without a file, a neutral
    picture of `size` (width, height). A video that ends early stands still."""
    blank: Image = np.full((size[1], size[0], 3), NEUTRAL_RGB, dtype=np.uint8)
    if file is None:
        yield from (blank for _ in frames)
        return
    reader = read_rgb(file, int(frames[0]), int(frames[-1]) + 1)
    number, picture = -1, blank
    for wanted in frames:
        while number < wanted:
            try:
                number, picture = next(reader)
            except StopIteration:
                break
        yield picture


# paints over a part of the picture of a used frame; (3, 3): from its pixels to the part's
Paint = Callable[[int, Image, Float[np.ndarray, "3 3"]], Image]

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
    part: slice = slice(None),
) -> list[SyncedVideo]:
    """The reference first, then the other videos named in `files` (None: there is no file).

    The moments are those of `common_moments`, or a part of them. paints: what is painted over some
    videos.
    """
    by_id = {v.id: v for v in keypoints.videos}
    moments, fps = common_moments(keypoints, sync)[part], by_id[sync.reference].fps
    order = [sync.reference, *(i for i in sync.ids if i != sync.reference)]
    shown = [by_id[i] for i in order if i in files]
    shape = tile_shape(shown)
    videos = []
    for video in shown:
        matches = sync.map_of(video.id)
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
    boxes = _boxes(video)
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
    size = (rows * (height + GAP_PX) - GAP_PX, columns * (width + GAP_PX) - GAP_PX)
    for moment in range(len(videos[0].frames)):
        film = np.full((*size, 3), FRAME_RGB, dtype=np.uint8)
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
    boxes = _boxes(video)
    width, height = np.quantile(boxes[:, 2:] - boxes[:, :2], 0.95, axis=0)
    return max(float(width), 1.0), max(float(height), 1.0)


def _boxes(video: VideoKeypoints) -> Float[np.ndarray, "T 4"]:
    """The performer's, those missing between their neighbours in time; the picture if all are."""
    boxes = filled_boxes(video.person_box_px)
    return np.where(np.isfinite(boxes), boxes, (0, 0, *video.size))


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
    part: slice = slice(None),
) -> Iterator[Image]:
    """The film of an action: the videos named in `files` (None: there is no file) on the common
    time axis, a frame at each of `common_moments`, or at a part of them; `paints`: what is painted
    over some videos."""
    fps = next(v.fps for v in keypoints.videos if v.id == sync.reference)
    videos = synced_videos(keypoints, sync, files, paints, part)
    film = side_by_side(videos, tile_shape([v for v in keypoints.videos if v.id in files]))
    title = f"{name}: {len(videos)} videos on one time axis"
    return framed(film, videos, common_moments(keypoints, sync)[part] / fps, title)


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
        write(head, clock, (picture.shape[1] - SIDE_PX, 31), 0.7, PALE_TEXT, before=1.0)
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
        write(bar, f"{second:g} s", place, 0.45, PALE_TEXT, before=0.5)
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
