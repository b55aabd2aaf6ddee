"""Hands end above the ground: what keypoints do not tell of them, the ground does.

A body's keypoints end at the wrists, so nothing says how a hand is turned, and a hand that carries
the body (in a plank, say) would stick in the ground, straight along the forearm. A hand whose tip
would be below the ground is lifted there, turning at the wrist where it points and towards its
back, as wrists do under load; the more it must turn, the more its palm faces the ground.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from imocap_core.body import Model
from imocap_core.body.kinematics import world_rotations
from imocap_core.camera.ground_plane import Ground
from imocap_core.conventions import SIDES, SMPL_JOINTS, SMPL_PARENTS

CLEARANCE_M = 0.03  # of a hand's middle, lying flat
STEEPEST_UP = 0.35  # sine by which a hand may point upwards to clear the ground
BACKWARDS = 2.0  # weight of its back, beside where it points, in where a lifted hand goes: wrists
# extend two to three times as far as they deviate
RESTING_RAD = 0.5  # from this much on, the palm faces the ground
KNOWN_HEIGHT_MM = 30.0  # standard deviation of the ground's height above which nothing is done


@dataclass(frozen=True)
class RestHand:
    """A hand at rest: where it points and its palm faces (unit vectors), its length in metres."""

    direction: Float[np.ndarray, "3"]
    palm: Float[np.ndarray, "3"]
    length_m: float


def rest_hand(model: Model, side: str) -> RestHand:
    """The hand of a model that stands with its arms to the sides and its palms down."""
    wrist, hand = (SMPL_JOINTS.index(f"{side}_{name}") for name in ("wrist", "hand"))
    joints = model.joints_template.cpu().numpy()
    owner = model.weights.argmax(dim=1).cpu().numpy()
    surface = model.v_template.cpu().numpy()[np.isin(owner, [wrist, hand])] - joints[wrist]
    along = joints[hand] - joints[wrist]
    direction = along / np.linalg.norm(along)
    length = float((surface @ direction).max())
    flat = surface[surface @ direction > 0.3 * length]
    palm = np.linalg.svd(flat - flat.mean(axis=0), full_matrices=False)[2][2]
    palm *= -np.sign(palm[1])
    palm -= (palm @ direction) * direction
    return RestHand(direction, palm / np.linalg.norm(palm), length)


def hands_on_ground(
    model: Model,
    R_local: Float[np.ndarray, "T 24 3 3"],
    joints: Float[np.ndarray, "T 24 3"],
    ground: Ground,
) -> tuple[Float[np.ndarray, "T 24 3 3"], Float[np.ndarray, "T 24 3"]]:
    """The motion with its hands above the ground; all joints but the hands' stay where they are.

    Args:
        joints: metres, in the axes of the root's rotation and of the ground.
    """
    if not ground.height_sd_mm <= KNOWN_HEIGHT_MM:
        return R_local, joints
    turned, moved = R_local.copy(), joints.copy()
    R_world = world_rotations(torch.from_numpy(R_local), SMPL_PARENTS).numpy()
    for side in SIDES:
        elbow, wrist, hand = (SMPL_JOINTS.index(f"{side}_{n}") for n in ("elbow", "wrist", "hand"))
        forearm, before = R_world[:, elbow], R_world[:, wrist]
        turn = turns_above_ground(
            rest_hand(model, side), before, ground.height_m(joints[:, wrist]), ground.up
        )
        turned[:, wrist] = forearm.swapaxes(1, 2) @ turn @ before
        offset = joints[:, hand] - joints[:, wrist]
        moved[:, hand] = joints[:, wrist] + (turn @ offset[..., None])[..., 0]
    return turned, moved


def turns_above_ground(
    hand: RestHand,
    R: Float[np.ndarray, "T 3 3"],
    wrist_height_m: Float[np.ndarray, " T"],
    up: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "T 3 3"]:
    """Rotations, applied after R, that keep a hand's tip above the ground.

    Args:
        R: the hand's rotation from rest.
    """
    direction, back = R @ hand.direction, -(R @ hand.palm)
    least = np.clip((CLEARANCE_M - wrist_height_m) / hand.length_m, -1.0, STEEPEST_UP)
    elevation = np.arcsin(np.clip(direction @ up, -1.0, 1.0))
    lift = np.maximum(np.arcsin(least) - elevation, 0.0)
    share = np.minimum(lift / RESTING_RAD, 1.0)[:, None]
    ahead = _level(direction + BACKWARDS * share * back, up)
    angle = (elevation + lift)[:, None]
    raised = _between(direction, np.cos(angle) * ahead + np.sin(angle) * up)
    raised = np.where((lift > 0)[:, None, None], raised, np.eye(3))
    along, palm = raised @ R @ hand.direction, raised @ R @ hand.palm
    down = -up + (along @ up)[:, None] * along
    sine = (along * np.cross(palm, down)).sum(-1)
    roll = np.arctan2(sine, (palm * down).sum(-1))
    rolled = Rotation.from_rotvec(share * roll[:, None] * along).as_matrix()
    return np.asarray(rolled @ raised)


def _level(vectors: Float[np.ndarray, "T 3"], up: Float[np.ndarray, "3"]) -> np.ndarray:
    """Unit vectors (T, 3) of the horizontal parts."""
    level = vectors - (vectors @ up)[:, None] * up
    return np.asarray(level / np.maximum(np.linalg.norm(level, axis=-1, keepdims=True), 1e-9))


def _between(a: Float[np.ndarray, "T 3"], b: Float[np.ndarray, "T 3"]) -> np.ndarray:
    """The least rotations (T, 3, 3) of unit vectors a onto b."""
    axis = np.cross(a, b)
    sine = np.linalg.norm(axis, axis=-1, keepdims=True)
    angle = np.arctan2(sine, (a * b).sum(-1, keepdims=True))
    return np.asarray(Rotation.from_rotvec(angle * axis / np.maximum(sine, 1e-9)).as_matrix())
