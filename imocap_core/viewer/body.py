"""The body in the viewer: a surface a shape, four bones a vertex, and poses frame by frame.

The page skins the surface itself (web/body.js, web/shaders.js), so a frame costs its angles only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from imocap_core.artifacts.schemas import VideoHands, VideoMotion
from imocap_core.body import Model
from imocap_core.body.conversions import pose_from_rotations, rotations_from_pose, smplh_from_smpl
from imocap_core.camera.world import (
    BodyMotion,
    Extrinsics,
    GroundAlignment,
    align_motion_to_ground,
    to_world,
)
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.viewer.block import Block, Entry, quantised

Array = NDArray[np.float64]

BONES = 4
LIGHTNESS = {"skin": 1.0, "hair": 0.42, "shirt": 0.8, "trousers": 0.52, "shoes": 0.3}
WRIST = 3 * SMPL_JOINTS.index("left_wrist")


@dataclass(frozen=True)
class Take:
    """One video's answer in the level world. theta (T, 3 J) radians, trans (T, 3) metres."""

    theta: Array
    betas: Array
    trans: Array
    joints: Array  # (T, 24, 3) metres


def take_of(
    motion: VideoMotion,
    camera: Extrinsics,
    level: GroundAlignment,
    hands: VideoHands | None,
    fingers: bool,
) -> Take:
    """A video's motion in the level world; with `fingers` in SMPL+H's joints.

    Without hands of its own, its fingers turn as SMPL's hand joints do.
    """
    own = BodyMotion(motion.theta, motion.trans, motion.joints)
    placed = align_motion_to_ground(to_world(own, camera), level)
    theta = placed.theta
    if fingers:
        R_local = smplh_from_smpl(rotations_from_pose(torch.as_tensor(theta)))
        theta = np.concatenate(
            [theta[:, :66], pose_from_rotations(R_local)[:, 66:].numpy()], axis=1
        )
    if hands is not None:
        theta = theta.copy()
        theta[:, WRIST : WRIST + 6] = hands.wrists.reshape(len(theta), -1)
        theta[:, 66:] = hands.fingers.reshape(len(theta), -1)
    return Take(theta, motion.betas, placed.trans, placed.joints)


def model_entry(block: Block, model: Model) -> dict[str, object]:
    """What all bodies share: the tree, faces, bones and their weights, how light each part is."""
    bones, weights = strongest_bones(model.weights.numpy())
    return {
        "parents": list(model.parents),
        "head": model.joint_names.index("head"),
        "faces": block.add(model.faces.numpy(), "u2"),
        "bones": block.add(bones, "u1"),
        "weights": block.add(weights, "u2"),
        "shades": block.add(shades(model), "u1"),
    }


def strongest_bones(weights: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The four strongest bones of each vertex, and their weights of 65535 together: (V, 4) each."""
    bones = np.argsort(-weights, axis=1, kind="stable")[:, :BONES]
    kept = np.take_along_axis(weights, bones, axis=1)
    whole = np.round(65535 * kept / kept.sum(axis=1, keepdims=True)).astype(np.int64)
    whole[:, 0] += 65535 - whole.sum(axis=1)  # a sum off by one would move the body by its place
    return bones, whole


def shades(model: Model) -> NDArray[np.int64]:
    """How light each vertex is, 0 to 255: the mean over its faces' parts."""
    if model.face_parts is None:
        return np.full(len(model.v_template), 200)
    part = np.array([LIGHTNESS.get(name, 0.8) for name in model.part_names])
    faces = model.faces.numpy()
    light = np.repeat(part[model.face_parts.numpy()], 3)
    total = np.bincount(faces.ravel(), light, minlength=len(model.v_template))
    count = np.bincount(faces.ravel(), minlength=len(model.v_template))
    return np.round(255 * total / np.maximum(count, 1)).astype(np.int64)


def shape_entry(block: Block, model: Model, betas: Array) -> dict[str, Entry | float]:
    """The rest surface and rest joints of one shape."""
    shaped = model.shape(torch.as_tensor(betas))
    rest, scale = quantised(shaped.vertices_rest.numpy())
    return {
        "rest": block.add(rest, "i2"),
        "scale": scale,
        "joints": block.add(shaped.joints_rest.numpy(), "f4"),
    }


def answer_entry(block: Block, take: Take) -> dict[str, Entry]:
    """The poses of a take, frame by frame."""
    return {"local": block.add(take.theta, "f4"), "trans": block.add(take.trans, "f4")}
