"""Standard deviations of joint angles from covariances of the joints' rotations."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from imocap_core.biomechanics.joint_angles import (
    ANATOMICAL_JOINTS,
    DECOMPOSITIONS,
    LEFT_OUT,
    WORLD,
    definition_of,
    distal_in_proximal,
)
from imocap_core.biomechanics.segments import anatomical_axes
from imocap_core.conventions import SIDES

STEP_RAD = 1e-5
PELVIS = ANATOMICAL_JOINTS.index("pelvis")
BY_TILT = ("pelvis_obliquity", "pelvis_tilt")  # unknown where the world's tilt is


def angle_spreads_deg(
    R_local: Float[np.ndarray, "T 24 3 3"],
    rest_m: Float[np.ndarray, "24 3"],
    covariance_deg2: Float[np.ndarray, "T 15 3 3"],
    *,
    tilt_sd_deg: float,
    camera_sd_deg: float = 0.0,
) -> dict[str, Float[np.ndarray, " T"]]:
    """Standard deviation of every angle, degrees, to first order; by `angle_names`. NaN where an
    angle or its covariance is.

    Args:
        R_local, rest_m: as of `joint_angles_deg`.
        covariance_deg2: of the rotations of `ANATOMICAL_JOINTS`, as of `rotation_jacobian`.
        tilt_sd_deg: of the world's up about each horizontal axis; NaN unknown.
        camera_sd_deg: of the camera in the world, three axes together.
    """
    of_world = np.full(3, camera_sd_deg**2 / 3) + np.nan_to_num(tilt_sd_deg) ** 2 * np.array(
        [1.0, 0.0, 1.0]
    )
    by_side = {side: anatomical_axes(R_local, rest_m, side) for side in SIDES}
    sd: dict[str, Float[np.ndarray, " T"]] = {}
    for k, joint in enumerate(ANATOMICAL_JOINTS):
        side, of = definition_of(joint)
        R = distal_in_proximal(of, by_side[side])
        covariance = covariance_deg2[:, k]
        if k == PELVIS:
            level = WORLD @ R
            covariance = covariance + np.einsum("tyx,y,tyz->txz", level, of_world, level)
        gradient = _gradient(R, of.order)
        variance = np.einsum("tax,txy,tay->ta", gradient, covariance, gradient)
        for (name, _), of_angle in zip(of.angles, np.sqrt(variance).T, strict=True):
            sd[f"{joint}_{name}"] = of_angle
    if np.isnan(tilt_sd_deg):
        sd |= {name: np.full(len(R_local), np.nan) for name in BY_TILT}
    return {name: of_angle for name, of_angle in sd.items() if not name.endswith(LEFT_OUT)}


def _gradient(R: Float[np.ndarray, "T 3 3"], order: str) -> Float[np.ndarray, "T 3 3"]:
    """Derivatives of a rotation's three angles (rows) by increments R <- R exp(delta)."""
    columns = []
    for axis in np.eye(3):
        step = Rotation.from_rotvec(STEP_RAD * axis).as_matrix()
        ahead, behind = (DECOMPOSITIONS[order](R @ turn) for turn in (step, step.T))
        change = (ahead - behind + np.pi) % (2 * np.pi) - np.pi
        columns.append(change / (2 * STEP_RAD))
    return np.stack(columns, axis=-1)
