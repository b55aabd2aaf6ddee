"""A motion clip as LAFAN1's files have it, for programs that put motion onto robots.

Twenty-two joints in LAFAN1's order, y up, 30 frames a second; centimetres are up to the writer.
Such programs use the joints' axes too: x points along the bone, and, of a body that stands with
its arms down, z to the left in the trunk and the arms, to the right in the legs. Our rest pose is
a T pose with all axes the body's (x left, y up, z ahead). Harvey et al., SIGGRAPH 2020.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation, Slerp

from imocap_core.io.writers.motion_clip import MotionClip
from imocap_core.io.writers.rigs import with_rest

FPS = 30.0
LEG = (("UpLeg", "hip"), ("Leg", "knee"), ("Foot", "ankle"), ("Toe", "foot"))
ARM = (("Shoulder", "collar"), ("Arm", "shoulder"), ("ForeArm", "elbow"), ("Hand", "wrist"))
SIDES = (("Left", "left"), ("Right", "right"))
JOINTS: dict[str, str] = {
    "Hips": "pelvis",
    **{f"{side}{name}": f"{ours}_{joint}" for side, ours in SIDES for name, joint in LEG},
    **{"Spine": "spine1", "Spine1": "spine2", "Spine2": "spine3", "Neck": "neck", "Head": "head"},
    **{f"{side}{name}": f"{ours}_{joint}" for side, ours in SIDES for name, joint in ARM},
}
"""LAFAN1's names in its order, and SMPL's of the same joints."""
BODY_LEFT, BODY_UP, BODY_AHEAD = np.eye(3)


def as_lafan1(clip: MotionClip) -> MotionClip:
    """The same motion with LAFAN1's joints, axes and frame rate; hands and fingers are left out.

    The world must have y up.
    """
    turned = with_rest(clip, np.swapaxes(joint_axes(clip), -1, -2))
    chosen = [clip.joint_names.index(joint) for joint in JOINTS.values()]
    place = {joint: n for n, joint in enumerate(chosen)}
    offsets = turned.offsets
    tips = dict(turned.tips)
    for joint, parent in enumerate(clip.parents):
        if parent in place and joint not in place:
            tips.setdefault(parent, offsets[joint])  # of a hand, to its knuckles
    subset = replace(
        turned,
        joint_names=tuple(JOINTS),
        parents=tuple(place.get(clip.parents[joint], -1) for joint in chosen),
        rest=turned.rest[chosen],
        tips={place[joint]: tip for joint, tip in tips.items() if joint in place},
        R_local=turned.R_local[:, chosen],
    )
    return at_rate(subset, FPS)


def joint_axes(clip: MotionClip) -> Float[np.ndarray, "J 3 3"]:
    """Columns: LAFAN1's axes of every joint, in the body's axes at our rest pose."""
    axes = np.tile(_frame(BODY_UP, BODY_LEFT), (len(clip.parents), 1, 1))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        of_side = {joint: clip.joint_names.index(f"{side}_{joint}") for _, joint in (*LEG, *ARM)}
        for chain, z_axis in (
            (("hip", "knee", "ankle", "foot"), -BODY_LEFT),
            (("collar", "shoulder", "elbow", "wrist"), sign * BODY_UP),
        ):
            bones = [of_side[joint] for joint in chain]
            for joint, child in pairwise(bones):
                axes[joint] = _frame(clip.rest[child] - clip.rest[joint], z_axis)
            axes[bones[-1]] = axes[bones[-2]]
        axes[of_side["foot"]] = _frame(BODY_AHEAD, -BODY_LEFT)  # a sole that lies flat
    return axes


def at_rate(clip: MotionClip, fps: float) -> MotionClip:
    """The same motion at another frame rate: rotations on the shortest arc, the path linear."""
    times = clip.times_s
    count = int(np.floor(times[-1] * fps + 1e-6)) + 1
    if count == len(times) and np.isclose(clip.fps, fps):
        return clip
    wanted = np.minimum(np.arange(count) / fps, times[-1])
    nearest = np.rint(wanted * clip.fps).astype(int).clip(0, len(times) - 1)
    R = clip.R_local
    if len(times) > 1:
        turns = [Slerp(times, Rotation.from_matrix(R[:, j]))(wanted) for j in range(R.shape[1])]
        R = np.stack([turn.as_matrix() for turn in turns], axis=1)
    pelvis = np.column_stack([np.interp(wanted, times, x) for x in clip.pelvis.T])
    return replace(
        clip,
        R_local=R,
        pelvis=pelvis,
        fps=fps,
        frames=np.interp(wanted, times, clip.frames),
        inside=clip.inside[nearest],
        phase_s=np.interp(wanted, times, clip.phase_s),
    )


def _frame(
    x_axis: Float[np.ndarray, "3"], z_axis: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3 3"]:
    """Columns x, y, z: x along a vector, z as near to another as it can be."""
    x = x_axis / np.linalg.norm(x_axis)
    y = np.cross(z_axis, x)
    y /= np.linalg.norm(y)
    return np.column_stack([x, y, np.cross(x, y)])
