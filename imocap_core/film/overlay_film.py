"""A video with the recovered body over each of its frames."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from imocap_core.body import Model
from imocap_core.figures.lettering import write_strip
from imocap_core.film.overlay_body import Image, OverlayBody, Painter, source_frames

USUAL_HEIGHT_PX = 720  # letters grow with the picture
SMALLEST, LARGEST = 0.6, 2.5


def overlay_film(overlay: OverlayBody, model: Model, *, alpha: float) -> Iterator[Image]:
    """Each used frame (height, width, 3) of a video with the body over it, named at the top."""
    video = overlay.keypoints
    painter = Painter(overlay, model, alpha=alpha)
    size = float(np.clip(video.size[1] / USUAL_HEIGHT_PX, SMALLEST, LARGEST))
    pictures = source_frames(overlay.file, video.frames, video.size)
    for t, (frame, picture) in enumerate(zip(video.frames, pictures, strict=True)):
        drawn = painter(t, picture)
        write_strip(drawn, video.id, f"frame {frame}", overlay.rgb, size)
        yield drawn
