"""Text on pictures, and title strips."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import UInt8

Image = UInt8[np.ndarray, "_ _ 3"]  # height, width, RGB
RGB = tuple[int, int, int]

FONT = cv2.FONT_HERSHEY_SIMPLEX
WHITE, PALE = (255, 255, 255), (225, 225, 225)
DIMMED = 0.35
STRIP_PX = 34  # height, on a picture of usual size
MARK_PX = 6  # width of the coloured mark at its left end


def write(
    picture: Image,
    text: str,
    point: tuple[int, int],
    size: float,
    rgb: RGB = WHITE,
    before: float = 0.0,
) -> None:
    """Write on the picture; the share `before` of the text is left of `point`, on its baseline."""
    (width, _), _ = cv2.getTextSize(text, FONT, size, 1)
    start = (round(point[0] - before * width), point[1])
    cv2.putText(picture, text, start, FONT, size, rgb, 1, cv2.LINE_AA)


def write_strip(picture: Image, left: str, right: str, rgb: RGB, size: float) -> None:
    """Darken the upper edge and write the picture's title there; `rgb` marks its left end."""
    strip = round(STRIP_PX * size)
    picture[:strip] = (picture[:strip] * DIMMED).astype(np.uint8)
    picture[:strip, :MARK_PX] = rgb
    line = round(0.7 * strip)
    write(picture, left, (16, line), 0.62 * size)
    if right:
        write(picture, right, (picture.shape[1] - 10, line), 0.55 * size, PALE, 1.0)
