"""Biovision hierarchy (BVH), and a clip as LAFAN1's files have it, for robots.

Biovision hierarchy (BVH): a joint tree, its offsets at rest, one line of channels per frame. Metres
(or another unit of the clip) and degrees. The root has six channels, XYZ position (the pelvis in
the world) and rotation; every other joint three rotations. A root bone and the pelvis below it have
six each. Channels are Z, Y, X: R = R_z R_y R_x. Angles are continuous from frame to frame, so that
programs may interpolate them.

A motion clip as LAFAN1's files have it, for programs that put motion onto robots. Twenty-two joints
in LAFAN1's order, y up, 30 frames a second; centimetres are up to the writer. Such programs use the
joints' axes too: x points along the bone, and, of a body that stands with its arms down, z to the
left in the trunk and the arms, to the right in the legs. Our rest pose is a T pose with all axes
the body's (x left, y up, z ahead). Harvey et al., SIGGRAPH 2020.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation, Slerp

from imocap_core.io.writers.motion_clip import MotionClip
from imocap_core.io.writers.rigs import with_rest

ROTATIONS = "Zrotation Yrotation Xrotation"
POSITIONS = "Xposition Yposition Zposition"
METRES, DEGREES = "{:.6f}", "{:.5f}"  # 0.001 mm; less at a bone's end


def write_bvh(file: Path, clip: MotionClip) -> None:
    """Write one motion clip."""
    file.write_text(bvh_text(clip), encoding="ascii", newline="\n")


def bvh_text(clip: MotionClip) -> str:
    """The content of the file."""
    order: list[int] = []
    lines = ["HIERARCHY", *_joint(clip, 0, 0, order)]
    lines += ["MOTION", f"Frames: {len(clip.R_local)}", f"Frame Time: {1.0 / clip.fps:.9f}"]
    angles = euler_zyx_deg(clip.R_local[:, order])
    paths = [clip.pelvis] if clip.root is None else [clip.root, clip.pelvis_from_root]
    for t, row in enumerate(angles):
        places = [[METRES.format(x) for x in path[t]] for path in paths]
        turns = [[DEGREES.format(a) for a in angle] for angle in row]
        first = [text for place, turn in zip(places, turns, strict=False) for text in place + turn]
        rest = [text for turn in turns[len(places) :] for text in turn]
        lines.append(" ".join(first + rest))
    return "\n".join(lines) + "\n"


def euler_zyx_deg(R: Float[np.ndarray, "T J 3 3"]) -> Float[np.ndarray, "T J 3"]:
    """Euler angles about z, y, x, degrees, of R = R_z R_y R_x, continuous over time.

    A rotation has two such triples, (z, y, x) and (z + 180, 180 - y, x + 180), each up to full
    turns: each frame gets the one nearest to the frame before.
    """
    flat = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_euler("ZYX", degrees=True)
    angles = flat.reshape(*R.shape[:2], 3)
    other = np.stack([angles[..., 0] + 180, 180 - angles[..., 1], angles[..., 2] + 180], axis=-1)
    path = angles.copy()
    for t in range(1, len(path)):
        near = [c + 360 * np.round((path[t - 1] - c) / 360) for c in (angles[t], other[t])]
        far = [np.abs(c - path[t - 1]).max(-1) for c in near]
        path[t] = np.where((far[0] <= far[1])[:, None], near[0], near[1])
    return path


def _joint(clip: MotionClip, joint: int, depth: int, order: list[int]) -> list[str]:
    """The lines of a joint and its descendants; `order` collects joints in the order written."""
    order.append(joint)
    pad, inside = "  " * depth, "  " * (depth + 1)
    kind = "JOINT" if depth else "ROOT"
    moves = joint == 0 or (joint == 1 and clip.root is not None)
    channels = f"6 {POSITIONS} {ROTATIONS}" if moves else f"3 {ROTATIONS}"
    lines = [
        f"{pad}{kind} {clip.joint_names[joint]}",
        f"{pad}{{",
        f"{inside}OFFSET {_metres(clip.offsets[joint])}",
        f"{inside}CHANNELS {channels}",
    ]
    for child in [j for j, parent in enumerate(clip.parents) if parent == joint]:
        lines += _joint(clip, child, depth + 1, order)
    if joint in clip.tips:
        tip = f"{inside}  OFFSET {_metres(clip.tips[joint])}"
        lines += [f"{inside}End Site", f"{inside}{{", tip, f"{inside}}}"]
    return [*lines, f"{pad}}}"]


def _metres(vector: Float[np.ndarray, "3"]) -> str:
    return " ".join(METRES.format(x) for x in vector)


FPS = 30.0
LEG = (("UpLeg", "hip"), ("Leg", "knee"), ("Foot", "ankle"), ("Toe", "foot"))
ARM = (("Shoulder", "collar"), ("Arm", "shoulder"), ("ForeArm", "elbow"), ("Hand", "wrist"))
SIDES = (("Left", "left"), ("Right", "right"))
LAFAN1_JOINTS: dict[str, str] = {
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
    turned = with_rest(clip, np.swapaxes(_joint_axes(clip), -1, -2))
    chosen = [clip.joint_names.index(joint) for joint in LAFAN1_JOINTS.values()]
    place = {joint: n for n, joint in enumerate(chosen)}
    offsets = turned.offsets
    tips = dict(turned.tips)
    for joint, parent in enumerate(clip.parents):
        if parent in place and joint not in place:
            tips.setdefault(parent, offsets[joint])  # of a hand, to its knuckles
    subset = replace(
        turned,
        joint_names=tuple(LAFAN1_JOINTS),
        parents=tuple(place.get(clip.parents[joint], -1) for joint in chosen),
        rest=turned.rest[chosen],
        tips={place[joint]: tip for joint, tip in tips.items() if joint in place},
        R_local=turned.R_local[:, chosen],
    )
    return at_rate(subset, FPS)


def _joint_axes(clip: MotionClip) -> Float[np.ndarray, "J 3 3"]:
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
