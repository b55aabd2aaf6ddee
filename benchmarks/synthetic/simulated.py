"""A simulated monocular 3D estimator, with errors in what one camera does not determine.

Joint errors are largest in depth, the orientation drifts, both slowly; bone lengths are constant,
as in learned estimators. Two parameters set the size of the errors. They were solved once
(tools/calibrate_estimator.py) so that the error on the five `protocol` clips is that of HMMR on
Human3.6M (MPJPE 109.8 mm, P-MPJPE 78.3 mm).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from benchmarks.synthetic.captured import COCO18, JOINT_INDEX, hip_middle
from imocap_core.conventions import EVAL_14, OTHER
from imocap_core.synthetic.detector import Detections, DetectorErrors, KeypointErrors, detect

# Joint and its parent ("": the middle of the hips), parents first.
TREE: tuple[tuple[str, str], ...] = (
    *(("left_hip", ""), ("right_hip", ""), ("neck", ""), ("head", "neck")),
    *((f"{s}_knee", f"{s}_hip") for s in ("left", "right")),
    *((f"{s}_ankle", f"{s}_knee") for s in ("left", "right")),
    *((f"{s}_shoulder", "neck") for s in ("left", "right")),
    *((f"{s}_elbow", f"{s}_shoulder") for s in ("left", "right")),
    *((f"{s}_wrist", f"{s}_elbow") for s in ("left", "right")),
)
# Error of each kind of joint relative to knees and elbows: the ends of limbs have the largest.
_RELATIVE_ERROR = {
    "hip": 0.5,
    "shoulder": 0.6,
    "neck": 0.5,
    "head": 0.8,
    "ankle": 1.4,
    "wrist": 1.4,
}


@dataclass(frozen=True)
class EstimatorErrors:
    """Errors of the simulated estimator.

    joint_m, orientation_rad: standard deviations per axis of the picture and per axis of rotation.
    depth: factor of the errors along the optical axis. joint_persistence_s,
    orientation_persistence_s: correlation times, seconds.
    """

    joint_m: float = 0.0445
    orientation_rad: float = 0.1027
    depth: float = 2.0
    joint_persistence_s: float = 0.25
    orientation_persistence_s: float = 1.0


def estimate(
    joints_cam_m: Float[np.ndarray, "T 14 3"],
    fps: float,
    rng: np.random.Generator,
    errors: EstimatorErrors | None = None,
) -> Float[np.ndarray, "T 14 3"]:
    """Simulated estimates of joints, relative to the middle of the hips, metres.

    joints_cam_m: true joints (EVAL_14) in camera axes (optical axis z); so are the estimates.
    """
    errors = errors or EstimatorErrors()
    true = joints_cam_m - hip_middle(joints_cam_m)[:, None]
    relative = np.array([_RELATIVE_ERROR.get(name.split("_")[-1], 1.0) for name in EVAL_14])
    noise = _smooth_noise(true.shape, errors.joint_persistence_s * fps, rng)
    scale = errors.joint_m * relative[:, None] * np.array([1.0, 1.0, errors.depth])
    noisy = _with_bone_lengths_of(true, true + scale * noise)
    drift = _smooth_noise((len(true), 3), errors.orientation_persistence_s * fps, rng)
    turn = Rotation.from_rotvec(errors.orientation_rad * drift).as_matrix()
    return np.einsum("tij,tkj->tki", turn, noisy)


def _with_bone_lengths_of(
    true: Float[np.ndarray, "T 14 3"], noisy: Float[np.ndarray, "T 14 3"]
) -> Float[np.ndarray, "T 14 3"]:
    """The noisy joints' bone directions with the true bones' lengths."""
    placed = np.zeros_like(true)
    nowhere = np.zeros_like(true[:, 0])
    for child, parent in TREE:
        a, b = JOINT_INDEX[child], JOINT_INDEX.get(parent)
        true_bone = true[:, a] - (nowhere if b is None else true[:, b])
        bone = noisy[:, a] - (nowhere if b is None else noisy[:, b])
        length = np.linalg.norm(true_bone, axis=-1) / np.linalg.norm(bone, axis=-1)
        placed[:, a] = (nowhere if b is None else placed[:, b]) + bone * length[:, None]
    return placed - hip_middle(placed)[:, None]


def _smooth_noise(
    shape: tuple[int, ...], frames: float, rng: np.random.Generator
) -> Float[np.ndarray, "T ..."]:
    """Stationary Gaussian-filtered noise of unit variance along the first axis; `frames`: the
    filter's standard deviation."""
    margin = int(np.ceil(4 * frames))
    white = rng.normal(size=(shape[0] + 2 * margin, *shape[1:]))
    kernel = np.zeros(2 * margin + 1)
    kernel[margin] = 1.0
    gain = np.linalg.norm(gaussian_filter1d(kernel, frames, mode="constant"))
    smooth = gaussian_filter1d(white, frames, axis=0, mode="constant") / gain
    return smooth[margin : margin + shape[0]]


# The simulated detectors of the benchmarks: `fine_tuned` for the scene, `generic`, `mediapipe`.
#
# Lengths are shares of the person's height in the picture: 4 and 8 px for a person 600 px tall,
# half of the variance correlated over time. `mediapipe` has the errors that were measured of
# MediaPipe Pose on rendered videos of training clips (tools/measure_detector.py).

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
