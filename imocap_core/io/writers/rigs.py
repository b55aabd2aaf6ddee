"""Joint names and rest poses of character rigs: Mixamo, Unreal Engine's mannequin, Rigify.

A motion clip keeps its bones' lengths; its joints are named as the rig's, and its tree rests in the
pose in which that rig rests, so that programs which retarget by name take it as it is.
"""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

if TYPE_CHECKING:
    from imocap_core.io.writers.gltf import Skin
    from imocap_core.io.writers.motion_clip import MotionClip


@dataclass(frozen=True)
class CharacterRig:
    """A rig's names of SMPL's joints, and how far its arms hang down at rest, degrees."""

    middle: dict[str, str]
    paired: dict[str, str]  # with {side}
    sides: Sequence[str]  # left, right
    finger: str  # with {name}, {n} and {side}
    arms_down_deg: float = 0.0
    finger_names: dict[str, str] | None = None

    def name(self, joint: str) -> str:
        """The rig's name of a joint of SMPL or SMPL+H."""
        if joint in self.middle:
            return self.middle[joint]
        side, _, part = joint.partition("_")
        sign = self.sides[0] if side == "left" else self.sides[1]
        if part in self.paired:
            return self.paired[part].format(side=sign)
        finger = (self.finger_names or {}).get(part[:-1], part[:-1])
        return self.finger.format(name=finger, n=part[-1], side=sign)


def _rigs() -> dict[str, CharacterRig]:
    text = Path(__file__).with_name("rigs.toml").read_text(encoding="utf-8")
    return {name: CharacterRig(**fields) for name, fields in tomllib.loads(text).items()}


RIGS = _rigs()


def as_rig(clip: MotionClip, name: str) -> MotionClip:
    """The same motion with a rig's names and rest pose."""
    if name not in RIGS:
        return clip
    rig = RIGS[name]
    posed = with_rest(clip, _arms_down(clip, rig.arms_down_deg)) if rig.arms_down_deg else clip
    return replace(posed, joint_names=tuple(map(rig.name, clip.joint_names)))


def skin_as_rig(skin: Skin, clip: MotionClip, name: str) -> Skin:
    """The skin of `clip` (before `as_rig`) at a rig's rest, by linear blend skinning."""
    down = RIGS[name].arms_down_deg if name in RIGS else 0.0
    if not down:
        return skin
    C = _arms_down(clip, down)
    rest = with_rest(clip, C).rest
    turned = np.einsum(
        "vkij,vkj->vki", C[skin.joints], skin.vertices[:, None] - clip.rest[skin.joints]
    )
    vertices = ((turned + rest[skin.joints]) * skin.weights[..., None]).sum(axis=1)
    return replace(skin, vertices=vertices)


def _arms_down(clip: MotionClip, angle_deg: float) -> Float[np.ndarray, "J 3 3"]:
    """Rotations of all joints from the T pose to one whose arms hang down by an angle."""
    C = np.tile(np.eye(3), (len(clip.parents), 1, 1))
    angle = np.radians(angle_deg)
    for side, sign in (("left", -1.0), ("right", 1.0)):
        sin, cos = np.sin(sign * angle), np.cos(angle)
        C[clip.joint_names.index(f"{side}_shoulder")] = [[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]
    for joint, parent in enumerate(clip.parents):
        if parent >= 0 and not clip.joint_names[joint].endswith("_shoulder"):
            C[joint] = C[parent]
    return C


def with_rest(clip: MotionClip, C: Float[np.ndarray, "J 3 3"]) -> MotionClip:
    """The same motion of a tree that rests in another pose.

    C: of every joint, the rotation in the body's axes from the rest pose to the new one. A joint
    that was turned by R against its parent is turned by C_parent R C^T against the new rest.
    """
    above = [max(parent, 0) for parent in clip.parents]
    R_local = C[above] @ clip.R_local @ np.swapaxes(C, -1, -2)
    R_local[:, 0] = clip.R_local[:, 0] @ C[0].T
    rest = np.zeros_like(clip.rest)
    for joint, parent in enumerate(clip.parents):
        if parent >= 0:
            rest[joint] = rest[parent] + C[parent] @ clip.offsets[joint]
    tips = {joint: C[joint] @ tip for joint, tip in clip.tips.items()}
    return replace(clip, rest=rest, tips=tips, R_local=R_local)
