"""Bodies of known upright direction, and the cameras that film them."""

from functools import cache

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from imocap_core import rotations
from imocap_core.body import load_free_body
from imocap_core.camera.gravity import FilmedBody
from imocap_core.camera.tilt_evidence import LevelPrior
from imocap_core.conventions import SMPL_JOINTS

Array = NDArray[np.float64]
PRIOR = LevelPrior(2.0, 8.0, 5.0)
FPS = 25.0
LEVEL_CAMERA = np.diag([1.0, -1.0, -1.0])  # of a world with y up; looks along -z


def posed(bends_deg: dict[str, tuple[float, float, float]], frames: int = 25) -> Array:
    """SMPL joints of a still body with some joints turned (axis-angle, degrees), its lowest point
    at 0; x to its left, y up and z ahead of a body at rest."""
    shaped = load_free_body().shape(torch.zeros(10, dtype=torch.float64))
    theta = torch.zeros(1, 24, 3, dtype=torch.float64)
    for name, turn in bends_deg.items():
        sides = ("left_", "right_") if SMPL_JOINTS.count(f"left_{name}") else ("",)
        for side in sides:
            mirror = (1.0, -1.0, -1.0) if side == "right_" else (1.0, 1.0, 1.0)
            of = torch.deg2rad(torch.tensor(turn) * torch.tensor(mirror))
            theta[0, SMPL_JOINTS.index(side + name)] = of
    placed = shaped.pose(rotations.exp(theta), torch.zeros(1, 3, dtype=torch.float64))
    joints = placed.joints.numpy() - (0.0, float(placed.mesh().vertices[..., 1].min()), 0.0)
    return np.repeat(joints, frames, axis=0)


SITTING = {"hip": (-80.0, 0.0, 0.0), "knee": (70.0, 0.0, 0.0)}


POSTURES: dict[str, dict[str, tuple[float, float, float]]] = {
    "push-up": {
        "pelvis": (72.0, 0.0, 0.0),
        "foot": (-30.0, 0.0, 0.0),
        "shoulder": (0.0, -75.0, 0.0),
        "wrist": (0.0, 0.0, 60.0),
    },
    "lying": {"pelvis": (-90.0, 0.0, 0.0)},
    "kneeling": {"knee": (90.0, 0.0, 0.0), "ankle": (40.0, 0.0, 0.0)},
    "handstand": {"pelvis": (180.0, 0.0, 0.0), "shoulder": (0.0, 0.0, 120.0)},
    "on a bench": {
        "pelvis": (-90.0, 0.0, 0.0),
        "hip": (20.0, 0.0, 0.0),
        "knee": (80.0, 0.0, 0.0),
        "shoulder": (0.0, -80.0, 0.0),
    },
    "shoulders on a bench": {"pelvis": (-60.0, 0.0, 0.0), "knee": (50.0, 0.0, 0.0)},
    "hanging": {"shoulder": (0.0, 0.0, 110.0), "hip": (-80.0, 0.0, 0.0)},
    "on bars": {"pelvis": (20.0, 0.0, 0.0), "shoulder": (0.0, -20.0, -65.0), "knee": (30, 0, 0)},
    "against a wall": {"pelvis": (35.0, 0.0, 0.0), "shoulder": (0.0, -80.0, 0.0)},
}


@cache
def standing(frames: int = 100) -> Array:
    """SMPL joints of a body that stands and lowers its arms; y up, the floor at 0."""
    shaped = load_free_body().shape(torch.zeros(10, dtype=torch.float64))
    theta = torch.zeros(frames, 24, 3, dtype=torch.float64)
    for name, sign in (("left_shoulder", -1.0), ("right_shoulder", 1.0)):
        theta[:, SMPL_JOINTS.index(name), 2] = sign * torch.linspace(0.2, 1.3, frames)
    floor = float(shaped.vertices_rest[:, 1].min())
    path = torch.tensor([0.0, -floor, 0.0], dtype=torch.float64).expand(frames, 3)
    return np.asarray(shaped.pose(rotations.exp(theta), path).joints.numpy())


def walking(frames: int = 120) -> Array:
    """The same body with feet that stand and swing in turn along z."""
    joints = standing(frames).copy()
    step = np.arange(frames)
    moved = np.zeros((frames, 2))
    for foot, side in enumerate(("left", "right")):
        swings = (step // 12 % 2) == foot
        moved[:, foot] = np.cumsum(np.where(swings, 0.05, 0.0))
        for part, share in (("knee", 0.5), ("ankle", 1.0), ("foot", 1.0)):
            joint = SMPL_JOINTS.index(f"{side}_{part}")
            joints[:, joint, 2] += share * moved[:, foot] + (1 - share) * moved.mean(axis=1)
            joints[:, joint, 1] += np.where(swings, 0.08 * share, 0.0)
    legs = [SMPL_JOINTS.index(f"{s}_{p}") for s in ("left", "right") for p in LEG_PARTS]
    others = [j for j in range(24) if j not in legs]
    joints[:, others, 2] += moved.mean(axis=1)[:, None]
    return joints


LEG_PARTS = ("knee", "ankle", "foot")


def turned(joints: Array, rotation: Rotation) -> Array:
    return np.asarray(rotation.apply(joints.reshape(-1, 3)).reshape(joints.shape))


def filmed(joints: Array, rotation: Rotation, camera: Array = LEVEL_CAMERA) -> FilmedBody:
    """A body and its camera together in a turned world."""
    return FilmedBody(turned(joints, rotation), FPS, camera @ rotation.as_matrix().T)


def angle_deg(a: Array, b: Array) -> float:
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))
