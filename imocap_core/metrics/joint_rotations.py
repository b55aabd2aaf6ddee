"""Errors of joint rotations: the angle between the estimated and the true rotation."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float

from imocap_core.body.kinematics import world_rotations
from imocap_core.conventions import SMPL_JOINTS, SMPL_PARENTS

SEGMENTS = ("pelvis", "spine3", "head", "neck", "left_collar", "right_collar")
"""The trunk's: first what turns as a whole, then bones of which only the direction counts."""
BONE_AT_REST = {
    "neck": np.array([0.0, 1.0, 0.0]),
    "left_collar": np.array([1.0, 0.0, 0.0]),
    "right_collar": np.array([-1.0, 0.0, 0.0]),
}
_FROBENIUS_AT_PI = 2.0 * np.sqrt(2.0)


def rotation_errors_deg(
    predicted: Float[np.ndarray, "*batch 3 3"], true: Float[np.ndarray, "*batch 3 3"]
) -> Float[np.ndarray, "*batch"]:
    """Geodesic distance of rotation matrices in degrees, 0 to 180.

    |A - B|_F = 2 sqrt(2) sin(angle / 2), which is accurate for small angles too (Huynh, "Metrics
    for 3D rotations", 2009). NaN where either is.
    """
    distance = np.linalg.norm(predicted - true, axis=(-1, -2))
    angle = 2 * np.arcsin(np.minimum(distance / _FROBENIUS_AT_PI, 1.0))
    return np.asarray(np.degrees(angle))


def joint_rotation_errors_deg(
    predicted: Float[np.ndarray, "T J 3 3"], true: Float[np.ndarray, "T J 3 3"]
) -> Float[np.ndarray, " J"]:
    """Mean over the frames of each joint's `rotation_errors_deg`."""
    return np.asarray(rotation_errors_deg(predicted, true).mean(axis=0))


def segment_rotations(
    R_local: Float[np.ndarray, "T 24 3 3"],
) -> dict[str, Float[np.ndarray, "T 3 3"]]:
    """SMPL joint -> rotation of its segment from rest to the root's parent axes (a camera's), for
    the `SEGMENTS` of a trunk."""
    R_world = world_rotations(torch.from_numpy(R_local), SMPL_PARENTS).numpy()
    return {name: R_world[:, SMPL_JOINTS.index(name)] for name in SEGMENTS}


def direction_errors_deg(
    predicted: Float[np.ndarray, "T 3 3"],
    true: Float[np.ndarray, "T 3 3"],
    bone: Float[np.ndarray, "3"],
) -> Float[np.ndarray, " T"]:
    """Angles in degrees between a bone turned by two rotations: turns about it do not count."""
    a, b = predicted @ bone, true @ bone
    sine = np.linalg.norm(np.cross(a, b), axis=-1)
    return np.asarray(np.degrees(np.arctan2(sine, (a * b).sum(-1))))


def mpjae_deg(predicted: Float[np.ndarray, "T J 3 3"], true: Float[np.ndarray, "T J 3 3"]) -> float:
    """Mean per-joint angular error (MPJAE) in degrees, over joints and frames.

    As in the challenge of von Marcard et al., "Recovering accurate 3D human pose in the wild",
    ECCV 2018, but of local rotations (relative to the parent joint): an error of the hips counts
    once, not again at every joint below them.
    """
    return float(rotation_errors_deg(predicted, true).mean())
