"""A video's monocular fit from a wrong start: the local minimum that such a start leads to.

Three ways in which monocular fits go wrong: the performer faces the other way, the depth of every
joint is reversed, and both at once, which is the mirror image in depth with left and right
exchanged.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.artifacts.schemas import CameraMotion, InitialSmpl, Keypoints, VideoMotion
from imocap_core.motion.mirror import mirrored_pose
from imocap_core.motion.monocular.fit import fit_monocular
from imocap_core.motion.monocular.library import make_library
from imocap_core.motion.monocular.starts import fit_rotations_to_joints, start_at_joints
from imocap_core.motion.prior import load_pose_prior
from imocap_core.params import Params
from imocap_core.problem.motions import motions_of
from imocap_core.problem.observations import body_for, observations_of
from imocap_core.rotations import exp

WrongStart = Literal["facing", "depth", "sides"]
WRONG_STARTS: tuple[WrongStart, ...] = get_args(WrongStart)


def wrongly_started(
    keypoints: Keypoints,
    cameras: CameraMotion,
    initial: InitialSmpl,
    video: int,
    wrong: WrongStart,
    params: Params,
) -> InitialSmpl:
    """The monocular motions, that of one video fitted anew from a wrong start alone."""
    body, prior, options = body_for(keypoints), load_pose_prior(), params.initial_smpl
    observation = observations_of(body, keypoints, cameras, params.fit)[video]
    motion = initial.videos[video]
    if wrong == "depth":
        library = make_library(
            body, prior, np.random.default_rng(video),
            poses=options.library_poses, directions=options.library_directions,
        )  # fmt: skip
        R_local = fit_rotations_to_joints(body, library, depth_reversed(motion.joints))
    else:
        R_local = facing_reversed(motion, sides_exchanged=wrong == "sides")
    start = start_at_joints(body, R_local, observation)
    stride = max(1, round(options.stride_s * observation.fps))
    fit = fit_monocular(
        body, prior, [observation], [[start]], params.fit,
        stride=stride, max_steps=options.max_steps,
    )  # fmt: skip
    alone = Keypoints(videos=[keypoints.videos[video]])
    videos = list(initial.videos)
    videos[video] = motions_of(body, fit.state, [observation], alone)[0]
    return initial.model_copy(update={"videos": videos})


def depth_reversed(joints: Float[np.ndarray, "T 24 3"]) -> Float[np.ndarray, "T 24 3"]:
    """Joints behind the root before it, and the reverse; the picture hardly changes."""
    root = joints[:, :1]
    return np.asarray(root + (joints - root) * np.array([1.0, 1.0, -1.0]))


def facing_reversed(motion: VideoMotion, *, sides_exchanged: bool) -> Float[Tensor, "T 24 3 3"]:
    """Rotations of a body turned by half a turn about the camera's vertical axis.

    ``sides_exchanged``: its mirror image, so that the picture stays but for left and right.
    """
    theta = mirrored_pose(motion.theta) if sides_exchanged else motion.theta
    R_local = exp(torch.as_tensor(theta).reshape(-1, 24, 3))
    half_turn = torch.diag(R_local.new_tensor([-1.0, 1.0, -1.0]))
    R_local[:, 0] = half_turn @ R_local[:, 0]
    return R_local
