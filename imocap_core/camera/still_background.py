"""The background of a camera that stands, without the person who moves before it: a median."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, UInt8

from imocap_core.camera.background import background_mask, filled_boxes

MOST = 15  # pictures
FEWEST_OF_A_PIXEL = 2  # pictures that show the background there


@dataclass(frozen=True)
class StillBackground:
    """A grey picture, and where it is background: where the person is not always in front of it."""

    picture: UInt8[np.ndarray, "H W"]
    is_background: Bool[np.ndarray, "H W"]


@dataclass(frozen=True)
class KeptPictures:
    """Some of a video's T pictures, evenly over it, filled as the video is read once."""

    count: int
    by_frame: dict[int, UInt8[np.ndarray, "H W"]]

    def passing(self, pictures: Iterable[UInt8[np.ndarray, "H W"]]) -> Iterator[np.ndarray]:
        """The pictures, unchanged; some are sampled."""
        wanted = set(np.linspace(0, self.count - 1, MOST).astype(int).tolist())
        for frame, picture in enumerate(pictures):
            if frame in wanted:
                self.by_frame[frame] = picture
            yield picture


def still_background(sampled: KeptPictures, box_px: Float[np.ndarray, "T 4"]) -> StillBackground:
    """The median of the kept pictures, each without the person's padded box.

    Args:
        box_px: x0, y0, x1, y1 of the person in pixels of these pictures; NaN where unknown.
    """
    boxes = filled_boxes(box_px)
    pictures = list(sampled.by_frame.values())
    masks = [background_mask(p.shape, boxes[t]) > 0 for t, p in sampled.by_frame.items()]
    return _median(pictures, masks)


def _median(pictures: Sequence[np.ndarray], masks: Sequence[np.ndarray]) -> StillBackground:
    shown = np.stack(masks)
    ordered = np.sort(np.where(shown, np.stack(pictures).astype(np.int16), 256), axis=0)
    count = shown.sum(axis=0)
    middle = np.take_along_axis(ordered, np.maximum(count - 1, 0)[None] // 2, axis=0)[0]
    least = min(FEWEST_OF_A_PIXEL, len(pictures))
    return StillBackground(np.minimum(middle, 255).astype(np.uint8), count >= least)
