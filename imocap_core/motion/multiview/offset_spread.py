"""Spread of performances' per-frame rigid offsets: six standard deviations a video.

Expectation maximisation on the offsets of `terms.rigid_offset`: given the spread, every frame's
offset has a posterior; given the posteriors, the variance is their mean square. Depth, which one
view hardly observes, keeps its prior and does not contradict the image plane, because a posterior
counts with its own uncertainty.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.kinematics import Body
from imocap_core.motion.multiview.cameras import Cameras
from imocap_core.motion.multiview.common_keypoints import CommonKeypoints, views_of
from imocap_core.motion.state import MotionState
from imocap_core.motion.terms import Reprojection, View
from imocap_core.params import MotionParams
from imocap_core.workers import at_once, in_turn

ROUNDS = 6
MIN_KEYPOINTS = 4  # fewer do not determine a rigid offset


def initial_offset_sd(videos: int, options: MotionParams) -> Float[np.ndarray, "M 6"]:
    """Generous standard deviations at which the estimation starts: rad, rad, rad, m, m, m."""
    rotation, translation = options.rigid_offset_start_rad, options.rigid_offset_start_m
    return np.tile([rotation] * 3 + [translation] * 3, (videos, 1))


def estimate_offset_sd(
    body: Body,
    motion: MotionState,
    keypoints: CommonKeypoints,
    cameras: Cameras,
    options: MotionParams,
    *,
    robust_scale: float,
) -> CommonKeypoints:
    """Keypoints with offset spreads estimated from them; a video without keypoints keeps its own.

    Args:
        motion: the common one (batch of 1, world axes).
    """
    if keypoints.offset_sd is None:
        return keypoints
    views = views_of(keypoints, cameras, motion.trans, free=())
    term = Reprojection(body, views, robust_scale)
    pairs = list(zip(views, keypoints.offset_sd, strict=True))
    each = in_turn if motion.trans.is_cuda else at_once
    spread = each(lambda pair: _offset_sd(term, pair[0], motion, pair[1], options), pairs)
    return replace(keypoints, offset_sd=np.stack(spread))


def _offset_sd(
    term: Reprojection, view: View, motion: MotionState, before: np.ndarray, options: MotionParams
) -> np.ndarray:
    usable = (view.weight > 0).sum(-1)[0] >= MIN_KEYPOINTS
    if not bool(usable.any()):
        return before
    sigma, offset = torch.as_tensor(before).to(motion.trans), None
    for _ in range(ROUNDS):
        precision = sigma.pow(-2).expand(1, len(usable), -1)
        offset, sharpness = term.rigid_offsets(view, motion, precision, offset)
        covariance = torch.linalg.inv(sharpness[0, usable])
        sigma = _mean_square(offset[0, usable], covariance, options).sqrt()
    return sigma.cpu().numpy()


def _mean_square(offset: Tensor, covariance: Tensor, options: MotionParams) -> Tensor:
    """(6,) one variance of the three rotations and one of the three translations."""
    square = offset.square() + covariance.diagonal(dim1=-2, dim2=-1)
    rotation = square[:, :3].mean().clamp_min(options.rigid_offset_floor_rad**2)
    translation = square[:, 3:].mean().clamp_min(options.rigid_offset_floor_m**2)
    return torch.cat([rotation.expand(3), translation.expand(3)])
