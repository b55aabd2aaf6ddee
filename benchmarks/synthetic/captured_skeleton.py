"""A captured skeleton's rigid segments, and how they stand in a neutral stance.

A joint of a captured skeleton whose children lie in different directions is a rigid body: its
orientation in a frame follows from theirs (Kabsch, Acta Cryst. A32, 1976). What transfers to
another body is that orientation relative to the same performer standing upright, because the joint
centres of two skeletons never coincide.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float

from imocap_core.rotations import exp

STANDING_LEAN_DEG = 15.0  # of the trunk, at most
STANDING_KNEE_DEG = 30.0
STANDING_FEET_M = 0.1  # difference in height
STANDING_HIPS_DEG = 8.0  # of the line through both hips
STRAIGHT_SHARE = 0.01  # the straightest hundredth of all frames counts as a straight limb
SHOULDER_LEVER = 0.15  # of the shoulders' line, for heads with a single child
NEAR_END = {"ankle": "knee", "wrist": "elbow", "hand": "wrist"}  # the bone before, by far ends
MIRROR = np.array([-1.0, 1.0, 1.0])


@dataclass(frozen=True)
class CapturedSkeleton:
    """Which captured joint plays which part; ``bones`` by the SMPL joint at their far end."""

    names: tuple[str, ...]
    parents: tuple[int, ...]
    pelvis: str
    chest: str
    neck: str
    head: str
    bones: Mapping[str, tuple[str, str]]

    def place(self, xyz: Float[np.ndarray, "T J 3"], joint: str) -> Float[np.ndarray, "T 3"]:
        """A joint's positions by its name."""
        return xyz[:, self.names.index(joint)]

    def bone(self, xyz: Float[np.ndarray, "T J 3"], far: str) -> Float[np.ndarray, "T 3"]:
        """Unit vector along the bone that ends in an SMPL joint."""
        start, end = self.bones[far]
        along = self.place(xyz, end) - self.place(xyz, start)
        unit: np.ndarray = along / np.linalg.norm(along, axis=-1, keepdims=True)
        return unit

    @property
    def trunk_bones(self) -> Mapping[str, tuple[str, str]]:
        """The captured joints at both ends of the neck's and the collars' bones."""
        bones = {"neck": (self.neck, self.head)}
        for side in ("left", "right"):
            shoulder = self.bones[f"{side}_elbow"][0]
            collar = self.names[self.parents[self.names.index(shoulder)]]
            bones[f"{side}_collar"] = (collar, shoulder)
        return bones

    def trunk_bone(self, xyz: Float[np.ndarray, "T J 3"], name: str) -> Float[np.ndarray, "T 3"]:
        """Unit vector along one of `trunk_bones`."""
        start, end = self.trunk_bones[name]
        along = self.place(xyz, end) - self.place(xyz, start)
        unit: np.ndarray = along / np.linalg.norm(along, axis=-1, keepdims=True)
        return unit

    def hip_line(self, xyz: Float[np.ndarray, "T J 3"]) -> Float[np.ndarray, "T 3"]:
        """From the right to the left hip."""
        left, right = (self.bones[f"{side}_knee"][0] for side in ("left", "right"))
        return self.place(xyz, left) - self.place(xyz, right)

    def rigid_points(
        self, xyz: Float[np.ndarray, "T J 3"], segment: str
    ) -> tuple[Float[np.ndarray, "T C 3"], list[str]]:
        """Vectors that turn with a segment (pelvis, chest or head), and their names."""
        joint = self.names.index(segment)
        shoulders = [self.bones[f"{side}_elbow"][0] for side in ("left", "right")]
        if segment == self.chest:
            ends = [self.neck, *shoulders]
        else:
            ends = [n for n, p in zip(self.names, self.parents, strict=True) if p == joint]
        vectors = np.stack([self.place(xyz, end) for end in ends], 1) - xyz[:, [joint]]
        if len(ends) > 1:
            return vectors, ends
        across = self.place(xyz, shoulders[0]) - self.place(xyz, shoulders[1])
        lever = SHOULDER_LEVER * across[:, None]
        return np.concatenate([vectors, lever, -lever], 1), [*ends, *shoulders]


@dataclass(frozen=True)
class NeutralStance:
    """How a performer's segments lie when standing, in body axes (x left, y up, z forward).

    Attributes:
        vectors: per segment (C, 3) metres, symmetric left and right.
        bend_rad: per SMPL joint at a bone's far end ("ankle": knee, "wrist": elbow, "hand":
            wrist) the angle between the captured bones of a straight limb: joint centres off the
            limb's axis make it differ from 0.
        trunk_bones: unit vectors along the neck and both collars.
    """

    vectors: Mapping[str, Float[np.ndarray, "_ 3"]]
    bend_rad: Mapping[str, float]
    trunk_bones: Mapping[str, Float[np.ndarray, "3"]]


def captured_skeleton(names: Sequence[str], parents: Sequence[int]) -> CapturedSkeleton:
    """The skeleton of some captured joints: CMU's conversion by cgspeed, or OptiTrack's.

    Raises:
        ValueError: for names of neither.
    """
    limbs: Mapping[str, tuple[str, str]]
    if {"abdomen", "chest", "lThigh"} <= set(names):
        parts = ("hip", "chest", "neck", "head")
        sides = {"left": "l", "right": "r"}
        limbs = {
            "knee": ("Thigh", "Shin"),
            "ankle": ("Shin", "Foot"),
            "foot": ("Foot", "Foot_end"),
            "elbow": ("Shldr", "ForeArm"),
            "wrist": ("ForeArm", "Hand"),
            "hand": ("Hand", "Mid1"),
        }
    elif {"Hips", "Chest", "LeftHip"} <= set(names):
        parts = ("Hips", "Chest", "Neck", "Head")
        sides = {"left": "Left", "right": "Right"}
        limbs = {
            "knee": ("Hip", "Knee"),
            "ankle": ("Knee", "Ankle"),
            "foot": ("Ankle", "Ankle_end"),
            "elbow": ("Shoulder", "Elbow"),
            "wrist": ("Elbow", "Wrist"),
            "hand": ("Wrist", "Wrist_end"),
        }
    else:
        raise ValueError(f"expected joints of CMU's or OptiTrack's skeleton, got {list(names)}")
    bones = {
        f"{side}_{far}": (prefix + start, prefix + end)
        for side, prefix in sides.items()
        for far, (start, end) in limbs.items()
    }
    return CapturedSkeleton(tuple(names), tuple(parents), *parts, bones)


def neutral_stance(
    skeleton: CapturedSkeleton, clips: Sequence[Float[np.ndarray, "_ J 3"]]
) -> NeutralStance:
    """The stance over all frames of one skeleton in which somebody stands upright (z up).

    Raises:
        ValueError: when nobody ever stands.
    """
    xyz = np.concatenate([np.asarray(clip, dtype=np.float64) for clip in clips])
    upright = xyz[standing_frames(skeleton, xyz)]
    if not len(upright):
        raise ValueError("no frame shows the performer standing upright with straight legs")
    body_from_world = _heading(skeleton, upright)
    vectors = {}
    for segment in (skeleton.pelvis, skeleton.chest, skeleton.head):
        turned, ends = skeleton.rigid_points(upright, segment)
        median = np.median(np.einsum("tij,tkj->tki", body_from_world, turned), axis=0)
        twins = [ends.index(_twin(end, ends)) for end in ends]
        vectors[segment] = 0.5 * (median + (median * MIRROR)[twins])
    bends = {
        far: float(np.quantile(_bends(skeleton, xyz, far), STRAIGHT_SHARE))
        for far in ("ankle", "wrist")
    }
    bends["hand"] = float(np.median(_bends(skeleton, upright, "hand")))  # hands hang relaxed
    return NeutralStance(vectors, bends, _trunk_bones(skeleton, upright, body_from_world))


def _trunk_bones(
    skeleton: CapturedSkeleton, xyz: np.ndarray, body_from_world: np.ndarray
) -> dict[str, np.ndarray]:
    """Median directions of the neck and both collars in body axes, symmetric left and right."""
    medians = {
        name: np.median(
            np.einsum("tij,tj->ti", body_from_world, skeleton.trunk_bone(xyz, name)), axis=0
        )
        for name in skeleton.trunk_bones
    }
    mirrored = {name: vector * MIRROR for name, vector in medians.items()}
    even = {
        name: vector + mirrored[_twin(name, tuple(medians))] for name, vector in medians.items()
    }
    return {name: vector / np.linalg.norm(vector) for name, vector in even.items()}


def standing_frames(
    skeleton: CapturedSkeleton, xyz: Float[np.ndarray, "T J 3"]
) -> Bool[np.ndarray, " T"]:
    """Frames with the trunk upright, both legs straight, the feet and the hips level."""
    up = np.array([0.0, 0.0, 1.0])
    trunk = skeleton.place(xyz, skeleton.chest) - skeleton.place(xyz, skeleton.pelvis)
    feet = [skeleton.place(xyz, skeleton.bones[f"{s}_ankle"][1])[:, 2] for s in ("left", "right")]
    tilt = angles_rad(skeleton.hip_line(xyz), up) - np.pi / 2
    frames: np.ndarray = (
        (np.degrees(angles_rad(trunk, up)) < STANDING_LEAN_DEG)
        & (np.degrees(_bends(skeleton, xyz, "ankle").reshape(2, -1)) < STANDING_KNEE_DEG).all(0)
        & (np.abs(feet[0] - feet[1]) < STANDING_FEET_M)
        & (np.abs(np.degrees(tilt)) < STANDING_HIPS_DEG)
    )
    return frames


def angles_rad(
    a: Float[np.ndarray, "*T 3"], b: Float[np.ndarray, "... 3"]
) -> Float[np.ndarray, "*T"]:
    """Angles between vectors, 0 to pi."""
    angle: np.ndarray = np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(-1))
    return angle


def _bends(skeleton: CapturedSkeleton, xyz: np.ndarray, far: str) -> np.ndarray:
    """(2 T,) angles between the two bones of both limbs."""
    near = NEAR_END[far]
    return np.concatenate(
        [
            angles_rad(skeleton.bone(xyz, f"{side}_{near}"), skeleton.bone(xyz, f"{side}_{far}"))
            for side in ("left", "right")
        ]
    )


def _heading(skeleton: CapturedSkeleton, xyz: np.ndarray) -> np.ndarray:
    """(T, 3, 3) body axes (left, up, forward) as rows, from the hips' line and gravity."""
    left = skeleton.hip_line(xyz) * np.array([1.0, 1.0, 0.0])
    left /= np.linalg.norm(left, axis=-1, keepdims=True)
    up = np.broadcast_to([0.0, 0.0, 1.0], left.shape)
    return np.stack([left, up, np.cross(left, up)], axis=1)


def _twin(name: str, names: Sequence[str]) -> str:
    """The same joint of the other side; itself in the middle of the body."""
    for a, b in (("left", "right"), ("Left", "Right"), ("l", "r")):
        for before, after in ((a, b), (b, a)):
            other = after + name.removeprefix(before)
            if name.startswith(before) and other in names:
                return other
    return name


# How the rigid segments of a captured skeleton turn, relative to its neutral stance.


def rotations_from_stance(
    skeleton: CapturedSkeleton, stance: NeutralStance, xyz: Float[np.ndarray, "T J 3"]
) -> Float[np.ndarray, "3 T 3 3"]:
    """Rotations of pelvis, chest and head from the neutral stance's body axes to the world."""
    return np.stack(
        [
            rotations_between(stance.vectors[segment], skeleton.rigid_points(xyz, segment)[0])
            for segment in (skeleton.pelvis, skeleton.chest, skeleton.head)
        ]
    )


def trunk_bone_rotations(
    skeleton: CapturedSkeleton, stance: NeutralStance, xyz: Float[np.ndarray, "T J 3"]
) -> Float[np.ndarray, "3 T 3 3"]:
    """Rotations of neck, left and right collar: the chest's, then the shortest to the bone.

    Two joints do not tell how a bone turns about itself.
    """
    chest = rotations_from_stance(skeleton, stance, xyz)[1]
    turned = []
    for name, template in stance.trunk_bones.items():
        in_chest = np.einsum("tji,tj->ti", chest, skeleton.trunk_bone(xyz, name))
        turned.append(chest @ shortest_rotations(template, in_chest))
    return np.stack(turned)


def shortest_rotations(
    start: Float[np.ndarray, "3"], end: Float[np.ndarray, "T 3"]
) -> Float[np.ndarray, "T 3 3"]:
    """The shortest rotation from one unit vector to others that are not opposite to it.

    1 + [v] + [v]^2 / (1 + cos), with v the cross product (Rodrigues).
    """
    cross = np.cross(start, end)
    x, y, z = cross.T
    zero = np.zeros_like(x)
    skew = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(-1, 3, 3)
    rotation: np.ndarray = np.eye(3) + skew + skew @ skew / (1.0 + end @ start)[:, None, None]
    return rotation


def rotations_between(
    template: Float[np.ndarray, "C 3"], observed: Float[np.ndarray, "T C 3"]
) -> Float[np.ndarray, "T 3 3"]:
    """The rotations that turn a template's vectors best into the observed ones (Kabsch 1976)."""
    U, _, Vt = np.linalg.svd(np.einsum("tci,cj->tij", observed, template))
    U[:, :, 2] *= np.sign(np.linalg.det(U @ Vt))[:, None]
    rotation: np.ndarray = U @ Vt
    return rotation


# How a straight upper arm is turned about itself: as bent arms of its elevation are.
#
# People turn their arms outwards as they raise them. Bones alone do not show it where the elbow is
# straight, so the mean over the bent arms of the training clips stands in
# (tools/measure_arm_twist.py; spread 18 to 39 degrees).

ELEVATION_DEG = (-75.0, -45.0, -15.0, 15.0, 45.0)
TWIST_DEG = (5.0, -8.0, -33.0, -56.0, -75.0)
"""Of a left arm, about its bone, from the shortest turn out of the T-pose."""


def natural_arm(
    bone: Float[np.ndarray, "3"], direction: Float[np.ndarray, "T 3"]
) -> Float[np.ndarray, "T 3 3"]:
    """Rotations of an upper arm in the chest's axes: its bone to a direction, twisted as bent arms
    of that elevation are in the mean."""
    elevation = np.degrees(np.arcsin(np.clip(direction[:, 1], -1.0, 1.0)))
    twist = np.sign(bone[0]) * np.radians(np.interp(elevation, ELEVATION_DEG, TWIST_DEG))
    turned = exp(torch.as_tensor(twist[:, None] * direction)).numpy()
    rotations: np.ndarray = turned @ shortest_rotations(bone / np.linalg.norm(bone), direction)
    return rotations
