"""The body of an artifact's parameters: its keypoints, its nose, its surface."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float

from imocap_core import rotations
from imocap_core.artifacts.schemas import VideoMotion
from imocap_core.body import Model, Posed
from imocap_core.evaluate.scoreboard import BodyPoints


def body_points(
    model: Model, motion: VideoMotion, layout: str, K: Float[np.ndarray, "3 3"]
) -> BodyPoints:
    """Keypoints of a layout and the nose in every frame of a motion, in its camera's axes."""
    posed = _posed(model, motion, range(len(motion.frames)))
    with_nose = model.points("coco17")
    nose = posed.keypoints(with_nose)[..., with_nose.names.index("nose"), :]
    return BodyPoints(nose.numpy(), posed.keypoints(model.points(layout)).numpy(), K)


def surfaces(
    model: Model, motion: VideoMotion, frames: Sequence[int]
) -> Float[np.ndarray, "F V 3"]:
    """Vertices at F frames (indices) of a motion, in its camera's axes."""
    return np.asarray(_posed(model, motion, frames).mesh().vertices.numpy())


def _posed(model: Model, motion: VideoMotion, frames: Sequence[int]) -> Posed:
    index = list(frames)
    theta = torch.from_numpy(motion.theta[index]).reshape(len(index), -1, 3)
    transl = torch.from_numpy(motion.trans[index])
    return model.shape(torch.from_numpy(motion.betas)).pose(rotations.exp(theta), transl)
