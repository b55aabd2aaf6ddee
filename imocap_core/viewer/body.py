"""The body in the viewer: one surface per shape, four bones per vertex, and poses per frame.

The page skins the surface itself (web/body.js, web/shaders.js), so a frame costs its angles only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int

from imocap_core.artifacts.schemas import VideoMotion
from imocap_core.body import Model, Shaped
from imocap_core.body.conversions import pose_from_rotations, rotations_from_pose, smplh_from_smpl
from imocap_core.camera.world import BodyMotion, Extrinsics, to_world
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.result.camera import VideoCamera
from imocap_core.result.video import VideoResult
from imocap_core.viewer.block import Block, Entry, quantised

BONES = 4
LIGHTNESS = {"skin": 1.0, "hair": 0.42, "shirt": 0.8, "trousers": 0.52, "shoes": 0.3}
BODY_ANGLES = 3 * SMPL_JOINTS.index("left_hand")  # those that SMPL and SMPL+H share


@dataclass(frozen=True, eq=False)
class ShownMotion:
    """One motion of a video in the level world.

    theta (T, 3 J): axis-angle radians; J as the model's. betas (B,). trans (T, 3), joints
    (T, 24, 3): metres.
    """

    theta: Float[np.ndarray, "T P"]
    betas: Float[np.ndarray, " B"]
    trans: Float[np.ndarray, "T 3"]
    joints: Float[np.ndarray, "T 24 3"]


def final_motion(video: VideoResult, fingers: bool) -> ShownMotion:
    """The motion of a levelled result; with `fingers` in SMPL+H's joints."""
    theta = with_fingers(video.theta) if fingers and video.hands is None else video.poses
    return ShownMotion(theta, video.betas, video.trans, video.body_joints)


def monocular_motion(motion: VideoMotion, camera: VideoCamera, fingers: bool) -> ShownMotion:
    """The monocular motion of a video, placed by the final camera of a levelled result."""
    placed = to_world(
        BodyMotion(motion.theta, motion.trans, motion.joints), Extrinsics(camera.R, camera.t)
    )
    theta = with_fingers(placed.theta) if fingers else placed.theta
    return ShownMotion(theta, motion.betas, placed.trans, placed.joints)


def with_fingers(theta: Float[np.ndarray, "T 72"]) -> Float[np.ndarray, "T 156"]:
    """SMPL's poses in SMPL+H's joints: fingers turn as SMPL's hand joints do."""
    R_local = smplh_from_smpl(rotations_from_pose(torch.as_tensor(theta)))
    fingers = pose_from_rotations(R_local)[:, BODY_ANGLES:].numpy()
    return np.concatenate([theta[:, :BODY_ANGLES], fingers], axis=1)


def model_entry(block: Block, model: Model) -> dict[str, object]:
    """Common to all bodies: joint tree, faces, bones and their weights, shades of the parts."""
    bones, weights = strongest_bones(model.weights.numpy())
    return {
        "parents": list(model.parents),
        "joints": [name.replace("_", " ") for name in model.joint_names],
        "head": model.joint_names.index("head"),
        "faces": block.add(model.faces.numpy(), "u2"),
        "bones": block.add(bones, "u1"),
        "weights": block.add(weights, "u2"),
        "shades": block.add(shades(model), "u1"),
    }


def strongest_bones(
    weights: Float[np.ndarray, "V J"],
) -> tuple[Int[np.ndarray, "V 4"], Int[np.ndarray, "V 4"]]:
    """The four strongest bones of each vertex, and their weights of 65535 together: (V, 4) each."""
    bones = np.argsort(-weights, axis=1, kind="stable")[:, :BONES]
    strongest = np.take_along_axis(weights, bones, axis=1)
    shares = strongest / strongest.sum(axis=1, keepdims=True)
    whole = np.round(65535 * shares).astype(np.int64)
    whole[:, 0] += 65535 - whole.sum(axis=1)  # else the body would move by 1/65535 of its place
    return bones, whole


def shades(model: Model) -> Int[np.ndarray, " V"]:
    """Brightness of each vertex, 0 to 255: the mean over its faces' parts."""
    if model.face_parts is None:
        return np.full(len(model.v_template), 200)
    part = np.array([LIGHTNESS.get(name, 0.8) for name in model.part_names])
    faces = model.faces.numpy()
    light = np.repeat(part[model.face_parts.numpy()], 3)
    total = np.bincount(faces.ravel(), light, minlength=len(model.v_template))
    count = np.bincount(faces.ravel(), minlength=len(model.v_template))
    return np.round(255 * total / np.maximum(count, 1)).astype(np.int64)


def shape_entry(block: Block, shaped: Shaped) -> dict[str, Entry | float]:
    """The rest surface and rest joints of one shape."""
    rest, scale = quantised(shaped.vertices_rest.numpy())
    return {
        "rest": block.add(rest, "i2"),
        "scale": scale,
        "joints": block.add(shaped.joints_rest.numpy(), "f4"),
    }


def motion_entry(block: Block, motion: ShownMotion) -> dict[str, Entry]:
    """The poses of a motion, frame by frame."""
    return {"local": block.add(motion.theta, "f4"), "trans": block.add(motion.trans, "f4")}
