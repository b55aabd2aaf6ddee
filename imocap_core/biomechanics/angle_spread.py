"""Standard deviations of joint angles from those of the joints' places.

A segment's direction errs by the errors of its two ends across it, divided by its length; an angle
between two segments by both, where a joint that they share enters once. Places are taken to err
independently of one another, which for neighbours is on the large side; but the hips, to whose
middle all places are relative, err by opposite amounts. Rotations about a segment's long axis move
no joint centre of their own, so that places say nothing about them.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from imocap_core.conventions import SMPL_JOINTS

Chain = tuple[str, str, str, str]  # proximal and distal end of the upper, then of the lower segment
TRUNK_ENDS = ("neck", "pelvis")
HIPS = ("left_hip", "right_hip")
BETWEEN: dict[str, Chain] = {  # angles that are those between two lines, or turn as these do
    "hip_flexion": (*TRUNK_ENDS, "hip", "knee"),
    "hip_adduction": (*HIPS, "hip", "knee"),
    "knee_flexion": ("hip", "knee", "knee", "ankle"),
    "ankle_dorsiflexion": ("knee", "ankle", "ankle", "foot"),
    "shoulder_elevation": (*TRUNK_ENDS, "shoulder", "elbow"),
    "elbow_flexion": ("shoulder", "elbow", "elbow", "wrist"),
}
BENDING: Chain = (*HIPS, "spine3", "neck")  # of the trunk, to a side


def angle_spreads_deg(
    joints_m: Float[np.ndarray, "T 24 3"],
    covariance_mm2: Float[np.ndarray, "T 24 3 3"],
    up: Float[np.ndarray, "3"],
    tilt_sd_deg: float,
) -> dict[str, Float[np.ndarray, " T"]]:
    """Standard deviation of every angle that joints' places determine, degrees; by `angle_names`.

    Joints, covariances and the direction `up` are in the same axes. NaN where a covariance is. Of
    segments in one line the angle has no plane, and any plane through them is taken.

    tilt_sd_deg: of `up` about each horizontal axis.
    """
    covariance_m2 = covariance_mm2 * 1e-6
    limbs = {
        f"{side}_{name}": np.degrees(_spread(joints_m, covariance_m2, chain, side))
        for name, chain in BETWEEN.items()
        for side in ("left", "right")
    }
    bending = np.degrees(_spread(joints_m, covariance_m2, BENDING, ""))
    rotation, obliquity = _hip_line(joints_m, covariance_m2, up)
    return limbs | {
        "pelvis_rotation": np.degrees(rotation),
        "pelvis_obliquity": np.hypot(np.degrees(obliquity), tilt_sd_deg),
        "trunk_right_bending": bending,
    }


def _hip_line(
    joints: Float[np.ndarray, "T 24 3"],
    covariance: Float[np.ndarray, "T 24 3 3"],
    up: Float[np.ndarray, "3"],
) -> tuple[Float[np.ndarray, " T"], Float[np.ndarray, " T"]]:
    """Standard deviations, radians, of the direction of the line through the hips: about the
    vertical, and from the horizontal. Its error is twice that of either hip. NaN for the former
    where the line is vertical."""
    left, right = (SMPL_JOINTS.index(hip) for hip in HIPS)
    line = joints[:, left] - joints[:, right]
    length = np.linalg.norm(line, axis=1)
    level = line - (line @ up)[:, None] * up
    reach = np.linalg.norm(level, axis=1)
    about = np.cross(up, level) / np.maximum(reach, 1e-12)[:, None]
    across = np.cross(line, about) / np.maximum(length, 1e-12)[:, None]
    of_line = 4 * covariance[:, left]
    turning = np.sqrt(np.einsum("ti,tij,tj->t", about, of_line, about))
    return (
        np.where(reach > 0.05 * length, turning / np.maximum(reach, 1e-12), np.nan),
        np.sqrt(np.einsum("ti,tij,tj->t", across, of_line, across)) / np.maximum(length, 1e-12),
    )


def _spread(
    joints: Float[np.ndarray, "T 24 3"],
    covariance: Float[np.ndarray, "T 24 3 3"],
    chain: Chain,
    side: str,
) -> Float[np.ndarray, " T"]:
    """Standard deviation of the angle between the two segments of a chain, radians."""
    a, b, c, d = (SMPL_JOINTS.index(n if n in SMPL_JOINTS else f"{side}_{n}") for n in chain)
    upper, lower = joints[:, b] - joints[:, a], joints[:, d] - joints[:, c]
    normal = np.cross(upper, lower)
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    lengths = np.linalg.norm(upper, axis=1, keepdims=True) * np.linalg.norm(
        lower, axis=1, keepdims=True
    )
    straight = size < 0.05 * lengths
    normal = np.where(straight, _across(lower), normal / np.maximum(size, 1e-12))
    # d angle = n . (l x dl / |l|^2 - u x du / |u|^2): a row of weights for each joint
    by_lower = np.cross(normal, lower) / (lower**2).sum(1, keepdims=True)
    by_upper = np.cross(normal, upper) / (upper**2).sum(1, keepdims=True)
    weights = np.zeros((len(joints), len(SMPL_JOINTS), 3))
    for joint, row in ((a, by_upper), (b, -by_upper), (c, -by_lower), (d, by_lower)):
        weights[:, joint] += row
    left, right = (SMPL_JOINTS.index(hip) for hip in HIPS)
    used = {a, b, c, d}
    if {left, right} <= used:  # what the right hip errs, the left one errs the other way
        weights[:, left] -= weights[:, right]
        used -= {right}
    rows = sorted(used)
    variance = np.einsum("tji,tjik,tjk->t", weights[:, rows], covariance[:, rows], weights[:, rows])
    return np.sqrt(variance)


def _across(direction: Float[np.ndarray, "T 3"]) -> Float[np.ndarray, "T 3"]:
    """A unit vector perpendicular to each direction."""
    least = np.eye(3)[np.abs(direction).argmin(axis=1)]
    normal = np.cross(direction, least)
    size: Float[np.ndarray, "T 1"] = np.linalg.norm(normal, axis=1, keepdims=True)
    return normal / size
