"""Model error: what the covariance of a posterior leaves out, measured on training clips.

A posterior is conditional on its model. Two things are not in it: the body's joint centres are not
the person's (a misfit that no evidence averages out), and neglected dependences, as of
correspondences and of errors that persist longer than they count for. The claimed covariance of a
joint is the posterior's, enlarged by a factor, plus an isotropic misfit of its kind of joint
(tools/fit_joint_uncertainty.py).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from imocap_core.conventions import SMPL_JOINTS

VARIANCE_FACTOR = 2.5
CAMERA_VARIANCE_FACTOR = 8.0
# standard deviation of each coordinate, millimetres
MISFIT_MM = {
    "hip": 0.0,
    "knee": 1.0,
    "ankle": 0.0,
    "shoulder": 14.0,
    "elbow": 5.0,
    "wrist": 0.0,
}
NEAREST_KIND = {"foot": "ankle", "hand": "wrist", "pelvis": "hip"}  # else the shoulder's


def claimed_covariance_m2(
    posterior_m2: Float[np.ndarray, "T 24 3 3"],
) -> Float[np.ndarray, "T 24 3 3"]:
    """Covariance of the joints about the middle of the hips, the model's error included."""
    misfit_m2 = np.square(1e-3 * np.array([_misfit_mm(name) for name in SMPL_JOINTS]))
    isotropic = misfit_m2[:, None, None] * np.eye(3)
    return np.asarray(VARIANCE_FACTOR * posterior_m2 + isotropic)


def claimed_rotation_sd(posterior_sd: float) -> float:
    """Standard deviation of a camera's rotation, of the same unit, the model's error included."""
    return float(np.sqrt(CAMERA_VARIANCE_FACTOR) * posterior_sd)


def _misfit_mm(joint: str) -> float:
    kind = joint.split("_")[-1]
    return MISFIT_MM.get(NEAREST_KIND.get(kind, kind), MISFIT_MM["shoulder"])
