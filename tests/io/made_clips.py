"""Small clips of the free body, with smooth random motion, for the laws of the writers."""

from dataclasses import dataclass

import numpy as np
import torch
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from imocap_core.body import Posed, Shaped, load_free_body
from imocap_core.io.writers.motion_clip import MotionClip, bone_tips


@dataclass(frozen=True)
class Made:
    """A clip, the body it is of, and the same poses by the body's own code."""

    clip: MotionClip
    shaped: Shaped
    posed: Posed


def made_clip(
    seed: int = 3, frames: int = 12, hands: bool = False, fps: float = 30.0, turn_rad: float = 2.0
) -> Made:
    """Every joint turns smoothly, by up to more than half a turn; the pelvis walks."""
    rng = np.random.default_rng(seed)
    shaped = load_free_body(hands=hands).shape(torch.as_tensor(0.7 * rng.normal(size=10)))
    joints = len(shaped.model.parents)
    noise = rng.normal(size=(frames, joints, 3))
    vectors = turn_rad * 2.5 * gaussian_filter1d(noise, 3.0, axis=0, mode="nearest")
    R_local = Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix()
    R_local = R_local.reshape(frames, joints, 3, 3)
    trans = np.cumsum(0.05 * rng.normal(size=(frames, 3)), axis=0) + [0.3, 0.9, -2.0]
    rest = shaped.joints_rest.numpy()
    clip = MotionClip(
        id="v1", joint_names=shaped.model.joint_names, parents=shaped.model.parents,
        rest=rest - rest[0], tips=bone_tips(shaped), R_local=R_local, pelvis=trans + rest[0],
        fps=fps, frames=np.arange(frames) + 7.0, inside=np.ones(frames, dtype=bool),
        phase_s=np.arange(frames) / fps,
    )  # fmt: skip
    return Made(clip, shaped, shaped.pose(torch.as_tensor(R_local), torch.as_tensor(trans)))
