"""One video's motion as exported: a joint tree, its rotations, its root path.

World axes are right-handed; export.json names the one that points up. At rest every joint's axes
are the body's (y up, facing +z), so a bone is the vector from joint to joint.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Bool, Float

from imocap_core.body.kinematics import joint_positions, world_rotations
from imocap_core.body.model import Shaped


@dataclass(frozen=True, eq=False)
class MotionClip:
    """One video's motion on one timeline, in one world.

    Attributes:
        id: the video. joint_names, parents: a parent comes before its children.
        rest: joints at rest, metres, the pelvis at the origin.
        tips: per joint without a child, the end of its bone from the joint, metres.
        R_local: relative to the parent; of joint 0 world from body. pelvis: metres.
        fps: frames of this clip per second. frames: source frame numbers, fractional between two.
        inside: False where the video does not show the moment and the body is frozen.
        phase_s: seconds of the reference; NaN where unknown.
        root: where the clip has a root bone, joint 0, its path on the floor; the pelvis is joint 1
            then, at the root's place at rest. `pelvis` is the pelvis' path in the world always.
    """

    id: str
    joint_names: tuple[str, ...]
    parents: tuple[int, ...]
    rest: Float[np.ndarray, "J 3"]
    tips: dict[int, Float[np.ndarray, "3"]]
    R_local: Float[np.ndarray, "T J 3 3"]
    pelvis: Float[np.ndarray, "T 3"]
    fps: float
    frames: Float[np.ndarray, " T"]
    inside: Bool[np.ndarray, " T"]
    phase_s: Float[np.ndarray, " T"]
    root: Float[np.ndarray, "T 3"] | None = None

    def __post_init__(self) -> None:
        """ValueError names every array whose shape does not match the others."""
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
    def times_s(self) -> Float[np.ndarray, " T"]:
        """Seconds from the clip's first frame."""
        return np.arange(len(self.R_local)) / self.fps

    @property
    def offsets(self) -> Float[np.ndarray, "J 3"]:
        """Every joint from its parent at rest, metres; 0 for the pelvis."""
        above = [max(parent, 0) for parent in self.parents]
        return self.rest - self.rest[above]

    @cached_property
    def joints(self) -> Float[np.ndarray, "T J 3"]:
        """Joint positions by forward kinematics, metres, world."""
        R_world = world_rotations(torch.as_tensor(self.R_local), self.parents)
        rest, path = torch.as_tensor(self.rest), torch.as_tensor(self.pelvis)
        if self.root is None:
            return joint_positions(R_world, rest, path, self.parents).numpy()
        below = tuple(parent - 1 for parent in self.parents[1:])
        body = joint_positions(R_world[:, 1:], rest[1:], path, below).numpy()
        return np.concatenate([self.root[:, None], body], axis=1)

    @property
    def pelvis_from_root(self) -> Float[np.ndarray, "T 3"]:
        """The pelvis' path in the axes of the root bone; ValueError where the clip has none."""
        if self.root is None:
            raise ValueError(f"clip {self.id}: there is no root bone")
        return np.einsum("tji,tj->ti", self.R_local[:, 0], self.pelvis - self.root)


def scaled(clip: MotionClip, factor: float) -> MotionClip:
    """The same motion with lengths in another unit, `factor` of which are a metre."""
    return replace(
        clip,
        rest=factor * clip.rest,
        tips={joint: factor * tip for joint, tip in clip.tips.items()},
        pelvis=factor * clip.pelvis,
        root=None if clip.root is None else factor * clip.root,
    )


def upright_rest(clip: MotionClip, up: str) -> MotionClip:
    """The same motion of a tree whose rest pose is upright in the world.

    Programs show the rest pose in world axes: with z up, a rest pose with y up would lie on its
    back. The tree at rest is turned by C (y to z), and every rotation with it: C R C^T, the root R
    C^T. ValueError unless `up` is y or z.
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


def bone_tips(shaped: Shaped) -> dict[int, Float[np.ndarray, "3"]]:
    """For every joint without a child the end of its bone, metres, from the joint at rest.

    The last bone is extended along its direction to the end of the surface that it moves most (the
    top of the head, the toes, a finger's tip), by 1 cm at least.
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
