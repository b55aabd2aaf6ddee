"""Biovision hierarchy (BVH): a joint tree, its offsets at rest, one line of channels per frame.

Metres (or another unit of the clip) and degrees. The root has six channels, XYZ position (the
pelvis in the world) and rotation; every other joint three rotations. A root bone and the pelvis
below it have six each. Channels are Z, Y, X: R = R_z R_y R_x. Angles are continuous from
frame to frame, so that programs may interpolate them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from imocap_core.io.writers.motion_clip import MotionClip

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
