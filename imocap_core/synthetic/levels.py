"""The two detectors of the benchmarks: one trained for the scene, one as it comes.

Lengths are shares of the person's height in the picture: 4 and 8 px for a person 600 px tall, half
of the variance persistent over time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imocap_core.render.arrays import Floats
from imocap_core.synthetic.captured import COCO18
from imocap_core.synthetic.detector import Detections, DetectorErrors, detect

DETECTORS: dict[str, DetectorErrors] = {
    "fine_tuned": DetectorErrors(
        noise=4 / 600, outlier_rate=0.02, miss_rate=0.02, swap_rate=0.0, stranger_rate=0.0
    ),
    "generic": DetectorErrors(
        noise=8 / 600, outlier_rate=0.05, miss_rate=0.05, swap_rate=0.01, stranger_rate=0.0
    ),
}


def detect_person(
    xy_px: Floats, height_px: Floats, fps: float, level: str, rng: np.random.Generator
) -> Detections:
    """Detections of COCO's 18 keypoints (T, 18, 2); a true keypoint that is NaN is never seen."""
    unseen: NDArray[np.bool_] = np.isnan(xy_px[..., :1])
    found = detect(np.where(unseen, 0.0, xy_px), height_px, COCO18, fps, rng, DETECTORS[level])
    return Detections(
        np.where(unseen, 0.0, found.xy_px), np.where(unseen[..., 0], 0.0, found.confidence)
    )
