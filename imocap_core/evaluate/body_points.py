"""Points of a posed body that a result's joints do not include: the nose and keypoints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from imocap_core import rotations
from imocap_core.artifacts.schemas import VideoMotion
from imocap_core.body import Model, Posed


@dataclass(frozen=True)
class BodyPoints:
    """Points in camera axes, metres.

    keypoints_m: in the layout of the detections. K: intrinsics with which the result projects.
    """

    nose_m: Float[np.ndarray, "T 3"]
    keypoints_m: Float[np.ndarray, "T K 3"]
    K: Float[np.ndarray, "3 3"]


def body_points(
    model: Model, motion: VideoMotion, layout: str, K: Float[np.ndarray, "3 3"]
) -> BodyPoints:
    """Keypoints of a layout and the nose in every frame of a motion, in its camera's axes."""
    posed = posed_body(model, motion, list(range(len(motion.frames))))
    with_nose = model.points("coco17")
    nose = posed.keypoints(with_nose)[..., with_nose.names.index("nose"), :]
    return BodyPoints(nose.cpu().numpy(), posed.keypoints(model.points(layout)).cpu().numpy(), K)


def posed_body(model: Model, motion: VideoMotion, frames: list[int]) -> Posed:
    """The body at some frames (indices) of a motion, in its camera's axes."""
    arrays = (motion.theta[frames], motion.trans[frames], motion.betas)
    theta, transl, betas = (torch.from_numpy(x).to(model.device) for x in arrays)
    by_joint = theta.reshape(len(frames), -1, 3)
    return model.shape(betas).pose(rotations.exp(by_joint), transl)
