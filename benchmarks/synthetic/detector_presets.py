"""The simulated detectors of the benchmarks: `fine_tuned` for the scene, `generic`, `mediapipe`.

Lengths are shares of the person's height in the picture: 4 and 8 px for a person 600 px tall, half
of the variance correlated over time. `mediapipe` has the errors that were measured of MediaPipe
Pose on rendered videos of training clips (tools/measure_detector.py).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from benchmarks.synthetic.captured import COCO18
from imocap_core.conventions import OTHER
from imocap_core.synthetic.detector import Detections, DetectorErrors, KeypointErrors, detect

MEDIAPIPE = {
    "nose": KeypointErrors(noise=0.8, outliers=0.0),
    "eye": KeypointErrors(noise=0.65, outliers=0.0),
    "ear": KeypointErrors(noise=0.75, outliers=0.05),
    "neck": KeypointErrors(noise=0.6, outliers=0.1),  # no such keypoint: midpoint of the shoulders
    "shoulder": KeypointErrors(0.8, 0.1, "elbow", 0.05),
    "elbow": KeypointErrors(1.3, 1.4, "shoulder", 0.085),
    "wrist": KeypointErrors(1.4, 3.2, "elbow", 0.095),
    "hip": KeypointErrors(0.7, 0.03, OTHER, 0.1),
    "knee": KeypointErrors(noise=0.8, outliers=0.15),
    "ankle": KeypointErrors(0.8, 1.1, "knee", 0.09),
    "heel": KeypointErrors(1.0, 1.2, "knee", 0.05),
    "big_toe": KeypointErrors(1.2, 1.9, "heel", 0.16),
}
DETECTORS: dict[str, DetectorErrors] = {
    "fine_tuned": DetectorErrors(
        noise=4 / 600, outlier_rate=0.02, miss_rate=0.02, swap_rate=0.0, false_person_rate=0.0
    ),
    "generic": DetectorErrors(
        noise=8 / 600, outlier_rate=0.05, miss_rate=0.05, swap_rate=0.01, false_person_rate=0.0
    ),
    "mediapipe": DetectorErrors(
        noise=0.0107,
        persistence_s=0.2,
        persistent_share=1.0,
        constant_offset=0.0105,
        difficulty_spread=0.5,
        outlier_rate=0.038,
        outlier_noise=0.10,
        outlier_s=0.08,
        miss_rate=0.001,
        swap_rate=0.003,
        full_swap_rate=0.001,
        false_person_rate=0.0,
        by_kind=MEDIAPIPE,
    ),
}


def detect_person(
    xy_px: Float[np.ndarray, "T 18 2"],
    height_px: Float[np.ndarray, " T"],
    fps: float,
    detector: str,
    rng: np.random.Generator,
) -> Detections:
    """Simulated detections of COCO's 18 keypoints; a true keypoint that is NaN is never detected.

    detector: a name among `DETECTORS`; the other arguments as in `detect`.
    """
    missing = np.isnan(xy_px[..., :1])
    true = np.where(missing, 0.0, xy_px)
    detections = detect(true, height_px, COCO18, fps, rng, DETECTORS[detector])
    return Detections(
        np.where(missing, 0.0, detections.xy_px),
        np.where(missing[..., 0], 0.0, detections.confidence),
    )
