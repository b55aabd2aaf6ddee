"""A library of posed skeletons seen from all sides, as starts of monocular fits.

Poses are drawn from the pose prior; directions cover the sphere; the rotation in the image
plane, the scale and the shift are solved in closed form when a detection is matched.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Complex, Float
from torch import Tensor

from imocap_core.motion.kinematics import Body
from imocap_core.motion.prior import PosePrior
from imocap_core.rotations import exp


@dataclass(frozen=True)
class Library:
    """S poses seen from V directions.

    Attributes:
        R_local: (S, 24, 3, 3) with the identity as global rotation.
        R_view: (V, 3, 3) camera from body, before the in-plane rotation.
        tilt_rad: (V,) angle by which the body's up direction leans to or from the camera.
        templates: (S * V, K) complex, keypoints x + i y in camera axes (y down), metres, relative
            to the root; row s * V + v.
        joints: (S, 24, 3) metres, body axes, relative to the root.
        pose_cost: (S,) twice the negative log likelihood under the prior.
    """

    R_local: Float[Tensor, "S 24 3 3"]
    R_view: Float[Tensor, "V 3 3"]
    tilt_rad: Float[Tensor, " V"]
    templates: Complex[Tensor, "SV K"]
    joints: Float[Tensor, "S 24 3"]
    pose_cost: Float[Tensor, " S"]


def make_library(
    body: Body, prior: PosePrior, rng: np.random.Generator, *, poses: int, directions: int
) -> Library:
    """Draw ``poses`` from the prior and view them from ``directions`` sides."""
    template = prior.mean
    theta = torch.as_tensor(prior.sample(poses, rng)).to(template)
    local = torch.cat([theta.new_zeros(poses, 1, 3), theta.reshape(poses, -1, 3)], 1)
    R_local = exp(local)
    shaped = body.model.shape(template.new_zeros(1, 10))
    posed = shaped.pose(R_local, template.new_zeros(poses, 3))
    root = posed.joints[:, :1]
    keypoints = posed.keypoints(body.keypoints) - root
    R_view, tilt = _view_rotations(directions, template)
    xy = torch.einsum("vij,skj->svki", R_view[:, :2], keypoints)
    templates = torch.complex(xy[..., 0], xy[..., 1]).flatten(0, 1)
    cost, _ = prior.best(theta)
    return Library(R_local, R_view, tilt, templates, posed.joints - root, cost)


def _view_rotations(count: int, template: Tensor) -> tuple[Tensor, Tensor]:
    """Fibonacci directions on the sphere: (V, 3, 3) camera from body, and tilts (V,).

    The body's axes are y up and z ahead, the camera's y down and z away: a body upright and
    facing the camera has the rotation diag(1, -1, -1).
    """
    index = torch.arange(count, dtype=template.dtype, device=template.device) + 0.5
    tilt = torch.asin(1 - 2 * index / count)
    yaw = torch.pi * (1 + 5**0.5) * index
    zero = torch.zeros_like(tilt)
    turn = exp(torch.stack([zero, yaw, zero], -1))
    lean = exp(torch.stack([torch.pi + tilt, zero, zero], -1))
    return lean @ turn, tilt
