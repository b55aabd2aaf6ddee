"""A video with the recovered body over each of its frames."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from imocap_core.body import Model
from imocap_core.figures.lettering import write_strip
from imocap_core.film.performer import Painter, Performer, source_frames

Image = NDArray[np.uint8]

USUAL_HEIGHT_PX = 720  # letters grow with the picture
SMALLEST, LARGEST = 0.6, 2.5


def overlay_film(performer: Performer, model: Model, *, alpha: float) -> Iterator[Image]:
    """Each used frame (height, width, 3) of a video with the body over it, named at the top."""
    seen = performer.seen
    painter = Painter(performer, model, alpha=alpha)
    size = float(np.clip(seen.size[1] / USUAL_HEIGHT_PX, SMALLEST, LARGEST))
    pictures = source_frames(performer.file, seen.frames, seen.size)
    for t, (frame, picture) in enumerate(zip(seen.frames, pictures, strict=True)):
        drawn = painter(t, picture)
        write_strip(drawn, seen.id, f"frame {frame}", performer.rgb, size)
        yield drawn
