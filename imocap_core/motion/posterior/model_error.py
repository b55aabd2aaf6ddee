"""Model error: what the covariance of a posterior leaves out, measured on training clips.

A posterior is conditional on its model, and neglects some dependences, as of correspondences and of
errors that persist longer than they count for. The claimed covariance is the posterior's times a
factor. Where all videos show one motion, the factor is small, and what is left is that a person's
joints are not exactly where those of the body model are (tools/fit_joint_uncertainty.py). Of a
detector whose errors last as long as a view does, these are left too, of one motion and of several.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

PERFORMANCES_FACTOR = 1.5
# Of one motion errors are smaller than the posterior's, which allows for differing performances
ONE_MOTION_FACTOR = 0.3
PLACE_SD_M = 0.006  # of a joint in the body, along each axis
SEGMENT_M = 0.4  # a limb's length
CAMERA_VARIANCE_FACTOR = 6.0


def claimed_covariance_m2(
    posterior_m2: Float[np.ndarray, "T 24 3 3"], *, one_motion: bool, lasting_sd_m: float = 0.0
) -> Float[np.ndarray, "T 24 3 3"]:
    """Covariance of the joints about the middle of the hips, the model's error included.

    Args:
        one_motion: whether all videos show one motion, and not performances that differ.
        lasting_sd_m: of a joint along each axis, what a detector's lasting errors leave.
    """
    factor, place_m = _model_error(one_motion, lasting_sd_m)
    return np.asarray(factor * posterior_m2 + place_m**2 * np.eye(3))


def claimed_rotations_deg2(
    posterior_rad2: Float[np.ndarray, "T K 3 3"], *, one_motion: bool, lasting_sd_m: float = 0.0
) -> Float[np.ndarray, "T K 3 3"]:
    """Covariance of the joints' rotations, the model's error included; arguments as above: a
    segment of which both ends are displaced is turned."""
    factor, place_m = _model_error(one_motion, lasting_sd_m)
    turned_deg = np.degrees(np.sqrt(2) * place_m / SEGMENT_M)
    return np.asarray(factor * np.degrees(np.degrees(posterior_rad2)) + turned_deg**2 * np.eye(3))


def _model_error(one_motion: bool, lasting_sd_m: float) -> tuple[float, float]:
    """The factor of the posterior, and the standard deviation of a joint's place."""
    if one_motion and lasting_sd_m == 0.0:
        return ONE_MOTION_FACTOR, PLACE_SD_M
    return PERFORMANCES_FACTOR, lasting_sd_m


def claimed_rotation_sd(posterior_sd: float) -> float:
    """Standard deviation of a camera's rotation, of the same unit, the model's error included."""
    return float(np.sqrt(CAMERA_VARIANCE_FACTOR) * posterior_sd)
