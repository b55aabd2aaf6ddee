"""The detectors of the benchmarks: one trained for the scene, one as it comes, one as measured.

Lengths are shares of the person's height in the picture: 4 and 8 px for a person 600 px tall, half
of the variance persistent over time. `mediapipe` errs as MediaPipe Pose does on rendered films of
training clips (tools/measure_detector.py).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imocap_core.conventions import OTHER
from imocap_core.render.arrays import Floats
from imocap_core.synthetic.captured import COCO18
from imocap_core.synthetic.detector import Detections, DetectorErrors, detect
from imocap_core.synthetic.marking import Marking

MEDIAPIPE = {
    "nose": Marking(noise=0.8, outliers=0.0),
    "eye": Marking(noise=0.65, outliers=0.0),
    "ear": Marking(noise=0.75, outliers=0.05),
    "neck": Marking(noise=0.6, outliers=0.1),  # it has none: the middle of its shoulders
    "shoulder": Marking(0.8, 0.1, "elbow", 0.05),
    "elbow": Marking(1.3, 1.4, "shoulder", 0.085),
    "wrist": Marking(1.4, 3.2, "elbow", 0.095),
    "hip": Marking(0.7, 0.03, OTHER, 0.1),
    "knee": Marking(noise=0.8, outliers=0.15),
    "ankle": Marking(0.8, 1.1, "knee", 0.09),
    "heel": Marking(1.0, 1.2, "knee", 0.05),
    "big_toe": Marking(1.2, 1.9, "heel", 0.16),
}
DETECTORS: dict[str, DetectorErrors] = {
    "fine_tuned": DetectorErrors(
        noise=4 / 600, outlier_rate=0.02, miss_rate=0.02, swap_rate=0.0, stranger_rate=0.0
    ),
    "generic": DetectorErrors(
        noise=8 / 600, outlier_rate=0.05, miss_rate=0.05, swap_rate=0.01, stranger_rate=0.0
    ),
    "mediapipe": DetectorErrors(
        noise=0.0107,
        persistence_s=0.2,
        persistent=1.0,
        lasting=0.0105,
        hard_spread=0.5,
        outlier_rate=0.038,
        outlier_noise=0.10,
        outlier_s=0.08,
        miss_rate=0.001,
        swap_rate=0.003,
        turn_rate=0.001,
        stranger_rate=0.0,
        marking=MEDIAPIPE,
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
