"""Mirror images of motions, cameras and keypoints: reflection about the plane x = 0.

A video that was filmed in a mirror, or flipped, shows left and right swapped. Its mirror image is
taken in the axes of its own camera, x -> -x with S = diag(-1, 1, 1), so that pictures are reflected
about the principal point. Every function is its own inverse.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from imocap_core.conventions import SMPL_JOINTS, mirror_indices

REFLECTION = np.array([-1.0, 1.0, 1.0])
TWINS = list(mirror_indices(SMPL_JOINTS))


def mirrored_pose(theta: Float[np.ndarray, "T 72"]) -> Float[np.ndarray, "T 72"]:
    """Axis-angle poses in a mirror: R -> S R S for each joint's twin."""
    vectors = theta.reshape(-1, 24, 3)[:, TWINS] * -REFLECTION  # axes of rotation turn too
    return vectors.reshape(-1, 72)


def mirrored_translation(
    trans: Float[np.ndarray, "T 3"], root_rest: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "T 3"]:
    """SMPL translations of the mirror image; root_rest: the resting root joint of the shape."""
    return (root_rest + trans) * REFLECTION - root_rest


def mirrored_joints(joints: Float[np.ndarray, "... 24 3"]) -> Float[np.ndarray, "... 24 3"]:
    """SMPL's joints in a mirror, left and right swapped."""
    return joints[..., TWINS, :] * REFLECTION


def mirrored_covariance(
    covariance: Float[np.ndarray, "... 24 3 3"],
) -> Float[np.ndarray, "... 24 3 3"]:
    """Covariances of SMPL's joints in a mirror: S C S of each joint's twin."""
    return covariance[..., TWINS, :, :] * REFLECTION[:, None] * REFLECTION


def mirrored_extrinsics(
    R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """The camera that films the mirror image of the world: S R S, S t; its intrinsics stay."""
    return REFLECTION[:, None] * R * REFLECTION, REFLECTION * t


def mirrored_pixels(
    xy_px: Float[np.ndarray, "T K 2"], K: Float[np.ndarray, "3 3"], twins: Sequence[int]
) -> Float[np.ndarray, "T K 2"]:
    """Keypoints of the reflected picture; twins: each keypoint's left-right counterpart."""
    reflected = np.stack([2.0 * K[0, 2] - xy_px[..., 0], xy_px[..., 1]], axis=-1)
    return reflected[:, list(twins)]


def mirrored_boxes(
    box_px: Float[np.ndarray, "T 4"], K: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "T 4"]:
    """Boxes x0 y0 x1 y1 of the reflected picture."""
    box = box_px.copy()
    box[:, [0, 2]] = 2.0 * K[0, 2] - box[:, [2, 0]]
    return box
