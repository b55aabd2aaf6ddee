"""One performance as every exported format wants it: a joint tree, its turns, its path, a camera.

World axes are right-handed; which of them points up is said beside the files (export.json). At rest
every joint's axes are the body's (y up, facing +z), so a bone is the vector from joint to joint.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray

from imocap_core.body.kinematics import joint_positions, world_rotations
from imocap_core.body.model import Shaped

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MotionClip:
    """One video's performance on one timeline, in one world.

    Attributes:
        id: the video. joint_names (J,), parents (J,): a parent comes before its children.
        rest (J, 3): joints at rest, metres, the pelvis at the origin.
        tips: per joint without a child, the end (3,) of its bone from the joint, metres.
        R_local (T, J, 3, 3): against the parent; joint 0 world from body. pelvis (T, 3) metres.
        fps: frames of this clip per second. frames (T,): source frame numbers, fractional between
            two. inside (T,): False where the video shows nothing of the moment and stands still.
        phase_s (T,): seconds of the reference; NaN where unknown.
    """

    id: str
    joint_names: tuple[str, ...]
    parents: tuple[int, ...]
    rest: Array
    tips: dict[int, Array]
    R_local: Array
    pelvis: Array
    fps: float
    frames: Array
    inside: NDArray[np.bool_]
    phase_s: Array

    def __post_init__(self) -> None:
        """Check that the arrays belong together; ValueError names every one that does not."""
        joints, length = len(self.parents), len(self.R_local)
        expected: dict[str, tuple[int, ...]] = {
            "rest": (joints, 3),
            "R_local": (length, joints, 3, 3),
            "pelvis": (length, 3),
            "frames": (length,),
            "inside": (length,),
            "phase_s": (length,),
        }
        wrong = [
            f"{name}: expected {shape}, got {getattr(self, name).shape}"
            for name, shape in expected.items()
            if getattr(self, name).shape != shape
        ]
        if not self.fps > 0:
            wrong.append(f"fps: expected > 0, got {self.fps}")
        if len(self.joint_names) != joints:
            wrong.append(f"joint_names: expected {joints}, got {len(self.joint_names)}")
        if wrong:
            raise ValueError(f"clip {self.id}: " + "; ".join(wrong))

    @property
    def times_s(self) -> Array:
        """(T,) seconds from the clip's first frame."""
        return np.arange(len(self.R_local)) / self.fps

    @property
    def offsets(self) -> Array:
        """(J, 3) every joint from its parent at rest, metres; the pelvis has none."""
        above = [max(parent, 0) for parent in self.parents]
        return self.rest - self.rest[above]

    @cached_property
    def joints(self) -> Array:
        """(T, J, 3) metres, world: forward kinematics."""
        R_world = world_rotations(torch.as_tensor(self.R_local), self.parents)
        rest, path = torch.as_tensor(self.rest), torch.as_tensor(self.pelvis)
        return joint_positions(R_world, rest, path, self.parents).numpy()


def upright_rest(clip: MotionClip, up: str) -> MotionClip:
    """The same motion of a tree whose rest pose stands on the world's ground.

    Programs show the rest pose in world axes: with z up, a rest pose of y up would lie on its back.
    The tree at rest is turned by C (y to z), and every rotation with it: C R C^T, the root R C^T.
    """
    if up not in ("y", "z"):
        raise ValueError(f"up: expected y or z, got {up!r}")
    if up == "y":
        return clip
    C = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    turned = C @ clip.R_local @ C.T
    turned[:, 0] = clip.R_local[:, 0] @ C.T
    tips = {joint: C @ tip for joint, tip in clip.tips.items()}
    return replace(clip, rest=clip.rest @ C.T, tips=tips, R_local=turned)


def bone_tips(shaped: Shaped) -> dict[int, Array]:
    """For every joint without a child the end of its bone (3,), metres, from the joint at rest.

    A bone goes on in its own direction as far as the surface that it moves the most of reaches
    (the head to its top, a foot to its toes, a finger to its tip), 1 cm at least.
    """
    parents = shaped.model.parents
    rest = shaped.joints_rest.numpy()
    surface = shaped.vertices_rest.numpy()
    owner = shaped.model.weights.argmax(1).numpy()
    tips = {}
    for joint in sorted(set(range(len(parents))) - set(parents)):
        bone = rest[joint] - rest[parents[joint]]
        ahead = bone / np.linalg.norm(bone)
        reach = ((surface[owner == joint] - rest[joint]) @ ahead).max(initial=0.01)
        tips[joint] = reach * ahead
    return tips
