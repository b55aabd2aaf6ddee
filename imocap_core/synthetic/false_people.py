"""False detections of a second person, as real detectors have them for a few frames."""

from __future__ import annotations

import numpy as np

from imocap_core.synthetic.detector import Detections, DetectorErrors


def false_people(
    performer: Detections,
    size: tuple[int, int],
    rng: np.random.Generator,
    errors: DetectorErrors | None = None,
) -> list[Detections | None]:
    """For each frame the false second person (K keypoints in one frame), or None.

    It is a copy of the performer, reduced in size, elsewhere in the picture, half of it missing. At
    least one appears in a video.
    """
    errors = errors or DetectorErrors()
    frames, count = performer.confidence.shape
    rate = errors.false_person_rate / errors.false_person_frames
    begins = np.flatnonzero(rng.random(frames) < rate)
    begins = np.append(begins, rng.integers(frames // 4, frames // 2))
    people: list[Detections | None] = [None] * frames
    for begin in begins:
        place = rng.uniform(0.1, 0.9, 2) * size
        scale = rng.uniform(0.25, 0.6)
        half = rng.random(count) < 0.5
        for frame in range(begin, min(begin + errors.false_person_frames, frames)):
            figure = performer.xy_px[frame]
            detected = performer.confidence[frame] > 0
            middle = figure[detected].mean(axis=0) if detected.any() else np.zeros(2)
            xy = place + scale * (figure - middle) + rng.normal(0.0, 2.0, figure.shape)
            visible = half & detected
            confidence = np.where(visible, rng.uniform(0.1, 0.5, count), 0.0)
            xy = np.where(visible[:, None], xy, 0.0)
            people[frame] = Detections(xy[None], confidence[None])
    return people
