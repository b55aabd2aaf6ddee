"""A video's monocular fit from a wrong start: the local minimum that such a start leads to.

Three ways in which monocular fits go wrong: the performer faces the other way, the depth of every
joint is reversed, and both at once, which is the mirror image in depth with left and right
swapped.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.adapters.observations import alternatives_of, body_for, motions_of, observations_of
from imocap_core.artifacts.schemas import CameraMotion, InitialSmpl, Keypoints, VideoMotion
from imocap_core.motion.monocular.fit import fit_monocular
from imocap_core.motion.monocular.hypotheses import alternatives
from imocap_core.motion.monocular.starts import (
    Library,
    Start,
    fit_rotations_to_joints,
    make_library,
    start_at_joints,
)
from imocap_core.motion.observations import Observation
from imocap_core.motion.prior import load_pose_prior
from imocap_core.motion.state import Body, mirrored_pose
from imocap_core.params import Params
from imocap_core.rotations import exp

WrongStart = Literal["facing", "depth", "sides"]


@dataclass(frozen=True)
class WrongView:
    """A video, by index, and how its monocular fit is started wrong."""

    video: int
    start: WrongStart


def wrongly_started(
    keypoints: Keypoints,
    cameras: CameraMotion,
    initial: InitialSmpl,
    views: Sequence[WrongView],
    params: Params,
) -> InitialSmpl:
    """The monocular motions, those of some videos fitted anew from a wrong start alone.

    A wrong fit takes the place of the likeliest motion, and the video's alternatives are what the
    stage makes of that fit: nothing of the undisturbed fits of these videos is left.
    """
    body, prior, options = body_for(keypoints), load_pose_prior(), params.initial_smpl
    library = make_library(
        body, prior, np.random.default_rng(len(keypoints.videos)),
        poses=options.library_poses, directions=options.library_directions,
    )  # fmt: skip
    observations = observations_of(body, keypoints, cameras, params.fit)
    videos, disturbed = list(initial.videos), {keypoints.videos[w.video].id for w in views}
    alternatives_stored = [a for a in initial.alternatives if a.motion.id not in disturbed]
    for wrong in views:
        observation = observations[wrong.video]
        start = _wrong_start(body, library, videos[wrong.video], wrong.start, observation)
        stride = max(1, round(options.stride_s * observation.fps))
        fit = fit_monocular(
            body, prior, [observation], [[start]], params.fit,
            stride=stride, max_steps=options.max_steps,
        )  # fmt: skip
        others = alternatives(
            body, prior, library, [observation], fit.coarse, params.fit,
            videos=[0], count=options.hypotheses - 1,
        )  # fmt: skip
        alone = Keypoints(videos=[keypoints.videos[wrong.video]])
        videos[wrong.video] = motions_of(body, fit.state, [observation], alone)[0]
        alternatives_stored += alternatives_of(body, others, [observation], alone)
    return initial.model_copy(update={"videos": videos, "alternatives": alternatives_stored})


def _wrong_start(
    body: Body, library: Library, motion: VideoMotion, wrong: WrongStart, observation: Observation
) -> Start:
    if wrong == "depth":
        R_local = fit_rotations_to_joints(body, library, depth_reversed(motion.joints))
    else:
        R_local = facing_reversed(motion, sides_swapped=wrong == "sides")
    return start_at_joints(body, R_local, observation)


def depth_reversed(joints: Float[np.ndarray, "T 24 3"]) -> Float[np.ndarray, "T 24 3"]:
    """Joints behind the root before it, and the reverse; the picture hardly changes."""
    root = joints[:, :1]
    return np.asarray(root + (joints - root) * np.array([1.0, 1.0, -1.0]))


def facing_reversed(motion: VideoMotion, *, sides_swapped: bool) -> Float[Tensor, "T 24 3 3"]:
    """Rotations of a body turned by half a turn about the camera's vertical axis.

    ``sides_swapped``: its mirror image, so that the picture stays but for left and right.
    """
    theta = mirrored_pose(motion.theta) if sides_swapped else motion.theta
    R_local = exp(torch.as_tensor(theta).reshape(-1, 24, 3))
    half_turn = torch.diag(R_local.new_tensor([-1.0, 1.0, -1.0]))
    R_local[:, 0] = half_turn @ R_local[:, 0]
    return R_local
