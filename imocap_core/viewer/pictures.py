"""Source frames for the viewer: small JPEG pictures one after another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from imocap_core.camera.lens import Lens
from imocap_core.io.video import read_rgb_of
from imocap_core.viewer.block import Block

Image = UInt8[np.ndarray, "H W 3"]
Window = tuple[int, int, int, int]  # x, y, width, height in pixels

LONGEST_PX = 352
QUALITY = 50
MARGIN = 0.22  # beside the performer's outermost positions, share of their span
ASPECTS = (0.75, 1.6)  # width / height of the part that is shown, where the picture allows
MOST_PICTURES = 1000  # of all videos together; of longer ones every second frame, or every third


def stride(lengths: list[int], most: int = MOST_PICTURES) -> int:
    """One of how many frames is shown, so that no more than about `most` are."""
    return max(1, -(-sum(lengths) // most))


def windows(
    boxes_px: Sequence[Float[np.ndarray, "_ 4"]], sizes: Sequence[tuple[int, int]]
) -> list[Window]:
    """For each video the part of its pictures in which the performer always is, of one aspect
    where the pictures allow.

    boxes_px: per video (T, 4) x0 y0 x1 y1 of every frame, NaN where unseen; sizes: width, height.
    """
    reaches = [_reach(boxes, size) for boxes, size in zip(boxes_px, sizes, strict=True)]
    aspects = [(x1 - x0) / (y1 - y0) for x0, y0, x1, y1 in reaches]
    aspect = float(np.clip(np.median(aspects), *ASPECTS))
    parts = []
    for reach, size in zip(reaches, sizes, strict=True):
        low, high = reach[:2], reach[2:]
        sides = np.maximum(high - low, [(high - low)[1] * aspect, (high - low)[0] / aspect])
        sides = np.minimum(np.round(sides), size)
        corner = np.clip(np.round((low + high - sides) / 2), 0, np.array(size) - sides)
        parts.append((int(corner[0]), int(corner[1]), int(sides[0]), int(sides[1])))
    return parts


def _reach(boxes_px: Float[np.ndarray, "T 4"], size: tuple[int, int]) -> Float[np.ndarray, " 4"]:
    """x0 y0 x1 y1 about all boxes with a margin; the whole picture where there is none."""
    visible = boxes_px[np.isfinite(boxes_px).all(axis=1)]
    if not len(visible):
        return np.array([0.0, 0.0, *size])
    low, high = visible[:, :2].min(axis=0), visible[:, 2:].max(axis=0)
    margin = MARGIN * float((high - low).max()) + 1
    return np.concatenate([low - margin, high + margin])


def picture_entry(
    block: Block,
    file: Path,
    frames: Int[np.ndarray, " T"],
    every: int,
    part: Window,
    lens: Lens | None = None,
) -> dict[str, Any] | None:
    """Pictures of every `every`-th used frame; None when the file ends before the first.

    frames (T,): source frame numbers. part: of each that is shown. lens: its distortion is taken
    out. A frame that the file lacks repeats the one before. ValueError when the file is no readable
    video.
    """
    shows = cutter(part, lens)
    wanted = frames[::every].tolist()
    shown = set(wanted)
    encoded: dict[int, bytes] = {
        number: small_jpeg(shows(picture)) for number, picture in read_rgb_of(file, shown)
    }
    if not encoded:
        return None
    parts, before = [], next(iter(encoded.values()))
    for number in wanted:
        before = encoded.get(number, before)
        parts.append(before)
    ends = np.cumsum([0, *(len(part) for part in parts)])
    return {
        "every": every,
        "kind": "image/jpeg",
        "starts": block.add(ends, "u4"),
        "bytes": block.add(np.frombuffer(b"".join(parts), np.uint8), "u1"),
    }


def cutter(part: Window, lens: Lens | None) -> Callable[[Image], Image]:
    """Cuts a part out of pictures, as a pinhole camera would show it; black beyond their border."""
    x, y, width, height = part
    if lens is None:
        return lambda picture: picture[y : y + height, x : x + width]
    grid = np.stack(np.meshgrid(np.arange(x, x + width), np.arange(y, y + height)), axis=-1)
    source = lens.distorted(grid.astype(np.float64)).astype(np.float32)
    x_map, y_map = source[..., 0], source[..., 1]
    return lambda picture: np.asarray(cv2.remap(picture, x_map, y_map, cv2.INTER_LINEAR), np.uint8)


def small_jpeg(picture: UInt8[np.ndarray, "H W 3"]) -> bytes:
    """An RGB picture as JPEG, its longer side at most LONGEST_PX."""
    scale = min(1.0, LONGEST_PX / max(picture.shape[:2]))
    size = (max(1, round(scale * picture.shape[1])), max(1, round(scale * picture.shape[0])))
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA) if scale < 1 else picture
    done, data = cv2.imencode(
        ".jpg", small[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY, cv2.IMWRITE_JPEG_OPTIMIZE, 1]
    )
    assert done
    return data.tobytes()
