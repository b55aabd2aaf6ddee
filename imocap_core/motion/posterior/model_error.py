"""Model error: what the covariance of a posterior leaves out, measured on training clips.

A posterior is conditional on its model, and neglects some dependences, as of correspondences and of
errors that persist longer than they count for. The claimed covariance is the posterior's, enlarged
by a factor (tools/fit_joint_uncertainty.py).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

# Performances of training clips ask for 2, one motion in all videos for less than 1.
VARIANCE_FACTOR = 1.5
CAMERA_VARIANCE_FACTOR = 6.0


def claimed_covariance_m2(
    posterior_m2: Float[np.ndarray, "T 24 3 3"],
) -> Float[np.ndarray, "T 24 3 3"]:
    """Covariance of the joints about the middle of the hips, the model's error included."""
    return np.asarray(VARIANCE_FACTOR * posterior_m2)


def claimed_rotation_sd(posterior_sd: float) -> float:
    """Standard deviation of a camera's rotation, of the same unit, the model's error included."""
    return float(np.sqrt(CAMERA_VARIANCE_FACTOR) * posterior_sd)
