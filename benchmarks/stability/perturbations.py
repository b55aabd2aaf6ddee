"""Harmless perturbations of an action: of its keypoints, its pictures, and its declaration.

Each keeps everything that a person would call the action: a result that it moves was not settled.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, UInt8

SHIFT_PX = 1.0
NOISE_SHARE = 0.01  # of the person's size in the picture
SCALE = 1.005
JPEG_QUALITY = 90

Points = Float[np.ndarray, "*people K 3"]  # x, y (pixels), confidence; confidence 0: missing
Picture = UInt8[np.ndarray, "height width 3"]
Declared = dict[str, Any]  # a video of action.yaml


@dataclass(frozen=True)
class Perturbation:
    """One change of an action; what is None stays as it is.

    points: of each frame's keypoints (points, the person's size in pixels, generator). picture: of
    each frame's picture. frames: of each video's range of frames (first, one past the last).
    """

    name: str
    title: str
    points: Callable[[Points, float, np.random.Generator], Points] | None = None
    picture: Callable[[Picture, np.random.Generator], Picture] | None = None
    frames: Callable[[int, int], tuple[int, int]] | None = None
    is_reversed: bool = False
    is_scaled: bool = False
    has_other_threads: bool = False


def shifted_points(points: Points, size_px: float, rng: np.random.Generator) -> Points:
    """All keypoints one pixel to the right and down."""
    return _moved(points, np.full((*points.shape[:-1], 2), SHIFT_PX))


def noisy_points(points: Points, size_px: float, rng: np.random.Generator) -> Points:
    """Independent normal noise of 1 % of the person's size on every coordinate."""
    return _moved(points, NOISE_SHARE * size_px * rng.normal(size=(*points.shape[:-1], 2)))


def scaled_points(points: Points, scale_xy: tuple[float, float]) -> Points:
    """Keypoints in a picture that is larger by a factor along each axis."""
    return np.concatenate([points[..., :2] * scale_xy, points[..., 2:]], axis=-1)


def person_size_px(people: Sequence[Points]) -> float:
    """Longer side of the box of the largest person of a frame; NaN where nobody is detected."""
    boxes = []
    for person in people:
        xy = person[person[:, 2] > 0, :2]
        if len(xy):
            boxes.append(float(np.ptp(xy, axis=0).max()))
    return max(boxes, default=float("nan"))


def recompressed_picture(picture: Picture, rng: np.random.Generator) -> Picture:
    """The picture after JPEG compression of quality 90."""
    bgr = np.ascontiguousarray(picture[..., ::-1])
    _, coded = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    decoded = np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR), np.uint8)
    return decoded[..., ::-1]


def grey_level_picture(picture: Picture, rng: np.random.Generator) -> Picture:
    """One grey level more or less in every pixel, at random: what decoders differ by."""
    step = rng.choice(np.array([-1, 1], np.int16), size=(*picture.shape[:2], 1))
    return np.clip(picture + step, 0, 255).astype(np.uint8)


def shifted_picture(picture: Picture, rng: np.random.Generator) -> Picture:
    """The picture one pixel to the right and down, its first row and column repeated."""
    return np.pad(picture, ((1, 0), (1, 0), (0, 0)), mode="edge")[:-1, :-1]


def without_first(first: int, stop: int) -> tuple[int, int]:
    """A range of frames without its first."""
    return first + 1, stop


def without_last(first: int, stop: int) -> tuple[int, int]:
    """A range of frames without its last."""
    return first, stop - 1


def scaled_size(size: tuple[int, int], even: bool) -> tuple[int, int]:
    """A picture's size half a percent larger, to the next even number where H.264 needs one."""
    step = 2 if even else 1
    width, height = (step * round(SCALE * side / step) for side in size)
    return width, height


def _moved(points: Points, by_px: Float[np.ndarray, "*people K 2"]) -> Points:
    """Detected keypoints moved; missing ones stay."""
    detected = points[..., 2:] > 0
    return np.concatenate([points[..., :2] + detected * by_px, points[..., 2:]], axis=-1)


UNDISTURBED = Perturbation("undisturbed", "undisturbed")
DECLARATIONS = (
    Perturbation("first_frame", "one frame less at the beginning", frames=without_first),
    Perturbation("last_frame", "one frame less at the end", frames=without_last),
    Perturbation("order", "order of the videos reversed", is_reversed=True),
    Perturbation("scale", "half a percent larger", is_scaled=True),
    Perturbation("threads", "another number of threads", has_other_threads=True),
)
OF_FILES = (
    UNDISTURBED,
    Perturbation("shift", "keypoints shifted by one pixel", points=shifted_points),
    Perturbation("noise", "1 % noise on the keypoints", points=noisy_points),
    *DECLARATIONS,
)
OF_PIXELS = (
    UNDISTURBED,
    Perturbation("jpeg", "JPEG of quality 90", picture=recompressed_picture),
    Perturbation("grey", "one grey level, as of another decoder", picture=grey_level_picture),
    Perturbation("shift", "pictures shifted by one pixel", picture=shifted_picture),
    *DECLARATIONS,
)
