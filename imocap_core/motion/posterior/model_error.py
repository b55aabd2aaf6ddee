"""Model error: what the covariance of a posterior leaves out, measured on training clips.

A posterior is conditional on its model, and neglects some dependences, as of correspondences and of
errors that persist longer than they count for. Nor are a person's joints exactly where those of the
body model are. The claimed covariance is the posterior's times a factor, plus that of the joints'
places (tools/fit_joint_uncertainty.py).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

# Where all videos show one motion, nothing is shared by mistake: errors are smaller than the
# posterior's, which allows for differing performances
ONE_MOTION_FACTOR, PERFORMANCES_FACTOR = 0.3, 1.75
PLACE_SD_M = 0.006  # of a joint in the body, along each axis
CAMERA_VARIANCE_FACTOR = 6.0


def claimed_covariance_m2(
    posterior_m2: Float[np.ndarray, "T 24 3 3"], *, one_motion: bool
) -> Float[np.ndarray, "T 24 3 3"]:
    """Covariance of the joints about the middle of the hips, the model's error included.

    Args:
        one_motion: whether all videos show one motion, and not performances that differ.
    """
    factor = ONE_MOTION_FACTOR if one_motion else PERFORMANCES_FACTOR
    return np.asarray(factor * posterior_m2 + PLACE_SD_M**2 * np.eye(3))


def claimed_rotation_sd(posterior_sd: float) -> float:
    """Standard deviation of a camera's rotation, of the same unit, the model's error included."""
    return float(np.sqrt(CAMERA_VARIANCE_FACTOR) * posterior_sd)
