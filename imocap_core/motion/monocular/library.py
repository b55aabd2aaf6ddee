"""A library of posed skeletons seen from all sides: where a monocular fit may start.

Poses are drawn from the pose prior; directions cover the sphere; the rotation in the image
plane, the scale and the shift are solved in closed form when a detection is matched.
"""

from dataclasses import dataclass

import numpy as np
import torch
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
        tilt_rad: (V,) how far the body's up direction leans towards or away from the camera.
        templates: (S * V, K) complex, keypoints x + i y in camera axes (y down), metres, relative
            to the root; row s * V + v.
        joints: (S, 24, 3) metres, body axes, relative to the root.
        pose_cost: (S,) twice the negative log likelihood under the prior.
    """

    R_local: Tensor
    R_view: Tensor
    tilt_rad: Tensor
    templates: Tensor
    joints: Tensor
    pose_cost: Tensor


def make_library(
    body: Body, prior: PosePrior, rng: np.random.Generator, *, poses: int, directions: int
) -> Library:
    """Draw ``poses`` from the prior and look at them from ``directions`` sides."""
    like = prior.mean
    theta = torch.as_tensor(prior.sample(poses, rng)).to(like)
    local = torch.cat([theta.new_zeros(poses, 1, 3), theta.reshape(poses, -1, 3)], 1)
    R_local = exp(local)
    shaped = body.model.shape(like.new_zeros(1, 10))
    posed = shaped.pose(R_local, like.new_zeros(poses, 3))
    root = posed.joints[:, :1]
    keypoints = posed.keypoints(body.keypoints) - root
    R_view, tilt = _view_rotations(directions, like)
    seen = torch.einsum("vij,skj->svki", R_view[:, :2], keypoints)
    templates = torch.complex(seen[..., 0], seen[..., 1]).flatten(0, 1)
    cost, _ = prior.best(theta)
    return Library(R_local, R_view, tilt, templates, posed.joints - root, cost)


def _view_rotations(count: int, like: Tensor) -> tuple[Tensor, Tensor]:
    """Fibonacci directions from which the body is seen, (V, 3, 3) camera from body, and tilts.

    The body's axes are y up and z ahead, the camera's y down and z away: a body upright and
    facing the camera has the rotation diag(1, -1, -1).
    """
    index = torch.arange(count, dtype=like.dtype, device=like.device) + 0.5
    tilt = torch.asin(1 - 2 * index / count)
    yaw = torch.pi * (1 + 5**0.5) * index
    zero = torch.zeros_like(tilt)
    turn = exp(torch.stack([zero, yaw, zero], -1))
    lean = exp(torch.stack([torch.pi + tilt, zero, zero], -1))
    return lean @ turn, tilt
