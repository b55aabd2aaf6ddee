"""A false second person in a detector's answer, as real ones have them for moments."""

import numpy as np

from imocap_core.synthetic.detector import Detections, DetectorErrors


def strangers(
    performer: Detections,
    size: tuple[int, int],
    rng: np.random.Generator,
    errors: DetectorErrors | None = None,
) -> list[Detections | None]:
    """For each frame the false second person a detector sees for a few frames, or None.

    It is the performer's own figure, shrunk, elsewhere in the picture, and half of it missing.
    Each entry holds one frame: xy_px (1, K, 2), confidence (1, K). There is at least one bout.
    """
    errors = errors or DetectorErrors()
    frames, count = performer.confidence.shape
    begins = np.flatnonzero(rng.random(frames) < errors.stranger_rate / errors.stranger_frames)
    begins = np.append(begins, rng.integers(frames // 4, frames // 2))
    found: list[Detections | None] = [None] * frames
    for begin in begins:
        place = rng.uniform(0.1, 0.9, 2) * size
        shrink = rng.uniform(0.25, 0.6)
        seen = rng.random(count) < 0.5
        for frame in range(begin, min(begin + errors.stranger_frames, frames)):
            figure = performer.xy_px[frame]
            known = performer.confidence[frame] > 0
            middle = figure[known].mean(axis=0) if known.any() else np.zeros(2)
            xy = place + shrink * (figure - middle) + rng.normal(0.0, 2.0, figure.shape)
            keep = seen & known
            confidence = np.where(keep, rng.uniform(0.1, 0.5, count), 0.0)
            found[frame] = Detections(np.where(keep[:, None], xy, 0.0)[None], confidence[None])
    return found
