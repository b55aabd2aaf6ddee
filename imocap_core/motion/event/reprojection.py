"""Reprojection of a rig's points, with its derivatives by camera, bias and point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from imocap_core.camera.pose_refinement import cross_matrix
from imocap_core.motion.event.keypoints import KeypointSamples
from imocap_core.motion.event.rig import (
    CAMERA,
    DISTORTION,
    FOCAL,
    OFFSET,
    RATE,
    ROTATION,
    TRANSLATION,
    CameraRig,
)

NEAREST_M = 0.01  # a point behind a camera counts as this far in front of it
LEAST_VIEWS = 2  # of a point: fewer do not place it


@dataclass(frozen=True)
class Projection:
    """Residuals of N moments, J points, M cameras, and what their derivatives are made of.

    Attributes:
        error_px: (N, J, M, 2) predicted minus detected, the bias among the prediction.
        x_cam: (N, J, M, 3) metres; flat: (N, J, M, 2) undistorted normalised coordinates.
    """

    error_px: Float[np.ndarray, "N J M 2"]
    x_cam: Float[np.ndarray, "N J M 3"]
    flat: Float[np.ndarray, "N J M 2"]


@dataclass(frozen=True)
class Derivatives:
    """camera: (N, J, M, 2, 12), a camera's columns and then its bias; point: (N, J, M, 2, 3)."""

    camera: Float[np.ndarray, "N J M 2 C"]
    point: Float[np.ndarray, "N J M 2 3"]


def project(rig: CameraRig, samples: KeypointSamples) -> Projection:
    """All points in all cameras, against the keypoints."""
    x_cam = np.einsum("mab,njb->njma", rig.R, rig.points) + rig.t
    depth = np.maximum(x_cam[..., 2:], NEAREST_M)
    flat = x_cam[..., :2] / depth
    bent = flat * (1 + rig.distortion[:, None] * (flat**2).sum(-1, keepdims=True))
    bias = samples.size_px[:, None, :, None] * rig.bias.swapaxes(0, 1)
    predicted = rig.focal_px[:, None] * bent + rig.K[:, :2, 2] + bias
    return Projection(predicted - samples.xy_px, x_cam, flat)


def placed(samples: KeypointSamples) -> Bool[np.ndarray, "N J"]:
    """The points that enough cameras see."""
    return (samples.weight > 0).sum(-1) >= LEAST_VIEWS


def visible(samples: KeypointSamples) -> Float[np.ndarray, "N J M"]:
    """The weights of the points that enough cameras see."""
    return np.where(placed(samples)[..., None], samples.weight, 0.0)


def derivatives(
    rig: CameraRig,
    samples: KeypointSamples,
    projection: Projection,
    moments: Float[np.ndarray, " N"],
) -> Derivatives:
    """Derivatives of the residuals; of the offset and rate by the keypoints' velocity."""
    flat, f = projection.flat, rig.focal_px[:, None]
    depth = np.maximum(projection.x_cam[..., 2], NEAREST_M)
    k, r2 = rig.distortion[:, None], (flat**2).sum(-1, keepdims=True)
    by_flat = 2 * k[..., None] * flat[..., :, None] * flat[..., None, :]
    by_flat[..., [0, 1], [0, 1]] += 1 + k * r2
    by_flat *= f[..., None]
    to_flat = np.zeros((*depth.shape, 2, 3))
    to_flat[..., 0, 0] = to_flat[..., 1, 1] = 1 / depth
    to_flat[..., :, 2] = -flat / depth[..., None]
    by_x_cam = by_flat @ to_flat
    turned = projection.x_cam - rig.t
    camera = np.zeros((*depth.shape, 2, CAMERA + 2))
    camera[..., ROTATION] = -by_x_cam @ cross_matrix(turned)
    camera[..., TRANSLATION] = by_x_cam
    camera[..., FOCAL] = f * (1 + k * r2) * flat
    camera[..., DISTORTION] = f * r2 * flat
    camera[..., OFFSET] = -samples.velocity_px
    camera[..., RATE] = -samples.velocity_px * (rig.rate * moments[:, None])[:, None, :, None]
    camera[..., [0, 1], [CAMERA, CAMERA + 1]] = samples.size_px[:, None, :, None]
    return Derivatives(camera, by_x_cam @ rig.R)
