"""A simulated monocular 3D estimator: what one camera cannot tell, it gets wrong.

Its joints err mostly in depth, its orientation drifts, both slowly; its body keeps the length of
its bones, as the bodies of learned estimators do. Two numbers set how much: they were solved once
(tools/calibrate_estimator.py) so that the error on the five `protocol` clips is that of HMMR on
Human3.6M (MPJPE 109.8 mm, P-MPJPE 78.3 mm).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from imocap_core.conventions import EVAL_14
from imocap_core.render.arrays import Floats
from imocap_core.synthetic.captured import AT, hip_middle

# Joint -> the joint it hangs on ("": the middle of the hips), parents first.
TREE: tuple[tuple[str, str], ...] = (
    *(("left_hip", ""), ("right_hip", ""), ("neck", ""), ("head", "neck")),
    *((f"{s}_knee", f"{s}_hip") for s in ("left", "right")),
    *((f"{s}_ankle", f"{s}_knee") for s in ("left", "right")),
    *((f"{s}_shoulder", "neck") for s in ("left", "right")),
    *((f"{s}_elbow", f"{s}_shoulder") for s in ("left", "right")),
    *((f"{s}_wrist", f"{s}_elbow") for s in ("left", "right")),
)
# How far each kind of joint strays, relative to knees and elbows: ends of limbs most.
_STRAY = {"hip": 0.5, "shoulder": 0.6, "neck": 0.5, "head": 0.8, "ankle": 1.4, "wrist": 1.4}


@dataclass(frozen=True)
class EstimatorErrors:
    """joint_m, orientation_rad: standard deviations (per axis of the picture, and per axis of
    rotation); depth: how much larger errors are along the optical axis; persistence in seconds."""

    joint_m: float = 0.0445
    orientation_rad: float = 0.1027
    depth: float = 2.0
    joint_persistence_s: float = 0.25
    orientation_persistence_s: float = 1.0


def estimate(
    joints_cam_m: Floats,
    fps: float,
    rng: np.random.Generator,
    errors: EstimatorErrors | None = None,
) -> Floats:
    """Estimated joints (T, 14, 3), relative to the middle of the hips, in camera axes, of true
    joints (T, 14, 3) in camera axes (optical axis z)."""
    errors = errors or EstimatorErrors()
    true = joints_cam_m - hip_middle(joints_cam_m)[:, None]
    stray = np.array([_STRAY.get(name.split("_")[-1], 1.0) for name in EVAL_14])
    noise = _slow(true.shape, errors.joint_persistence_s * fps, rng)
    scale = errors.joint_m * stray[:, None] * np.array([1.0, 1.0, errors.depth])
    bent = _with_bones_of(true, true + scale * noise)
    drift = _slow((len(true), 3), errors.orientation_persistence_s * fps, rng)
    turn = Rotation.from_rotvec(errors.orientation_rad * drift).as_matrix()
    turned: Floats = np.einsum("tij,tkj->tki", turn, bent)
    return turned


def _with_bones_of(true: Floats, strayed: Floats) -> Floats:
    """The strayed joints' bone directions with the true bones' lengths."""
    placed = np.zeros_like(true)
    nowhere = np.zeros_like(true[:, 0])
    for child, parent in TREE:
        a, b = AT[child], AT.get(parent)
        true_bone = true[:, a] - (nowhere if b is None else true[:, b])
        bone = strayed[:, a] - (nowhere if b is None else strayed[:, b])
        length = np.linalg.norm(true_bone, axis=-1) / np.linalg.norm(bone, axis=-1)
        placed[:, a] = (nowhere if b is None else placed[:, b]) + bone * length[:, None]
    return placed - hip_middle(placed)[:, None]


def _slow(shape: tuple[int, ...], frames: float, rng: np.random.Generator) -> Floats:
    """Smooth stationary noise of unit variance along the first axis; `frames`: its time scale."""
    margin = int(np.ceil(4 * frames))
    white = rng.normal(size=(shape[0] + 2 * margin, *shape[1:]))
    kernel = np.zeros(2 * margin + 1)
    kernel[margin] = 1.0
    gain = np.linalg.norm(gaussian_filter1d(kernel, frames, mode="constant"))
    smooth: Floats = gaussian_filter1d(white, frames, axis=0, mode="constant") / gain
    return smooth[margin : margin + shape[0]]
