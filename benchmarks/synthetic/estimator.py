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

from benchmarks.synthetic.captured import JOINT_INDEX, hip_middle
from imocap_core.conventions import EVAL_14

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
