"""Draw docs/images/free_body.png: the free body in ten poses, three shapes, and its hands.

python tools/make_body_picture.py docs/images/free_body.png
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np
import torch

from imocap_core.body import Model, load_free_body
from imocap_core.render import draw_mesh
from imocap_core.rotations import exp

TILE_PX = (264, 330)
PAPER = 236
COLORS_BGR = {
    "skin": (150, 178, 226),
    "hair": (38, 46, 66),
    "shirt": (168, 104, 62),
    "trousers": (92, 74, 66),
    "shoes": (62, 58, 56),
}
Pose = dict[str, tuple[float, float, float]]  # joint -> axis-angle, degrees

ARMS_DOWN: Pose = {"left_shoulder": (0, 0, -75), "right_shoulder": (0, 0, 75)}
POSES: tuple[Pose, ...] = (
    {},
    ARMS_DOWN,
    {"left_shoulder": (0, 0, 70), "right_shoulder": (0, 0, -70),
     "left_collar": (0, 0, 15), "right_collar": (0, 0, -15)},
    {"left_hip": (-95, 0, 15), "right_hip": (-95, 0, -15), "left_knee": (110, 0, 0),
     "right_knee": (110, 0, 0), "left_ankle": (-25, 0, 0), "right_ankle": (-25, 0, 0),
     "spine1": (20, 0, 0), "left_shoulder": (0, -85, 0), "right_shoulder": (0, 85, 0)},
    {"left_hip": (-85, 0, 0), "left_knee": (85, 0, 0), "right_hip": (40, 0, 0),
     "right_knee": (25, 0, 0), "left_shoulder": (0, 0, 65), "right_shoulder": (0, 0, -65),
     "left_collar": (0, 0, 15), "right_collar": (0, 0, -15)},
    {"left_elbow": (0, -120, 0), "right_elbow": (0, 120, 0), **ARMS_DOWN},
    {"left_hip": (-100, 0, 0), "right_shoulder": (0, 50, 30), "left_shoulder": (0, 20, -30),
     "spine1": (0, 20, 0)},
    {"spine1": (0, 20, 0), "spine2": (0, 20, 0), "spine3": (0, 20, 0), "neck": (0, 20, 0),
     "head": (0, 20, 0), **ARMS_DOWN},
    {"spine1": (0, 0, 20), "spine2": (0, 0, 20), "left_hip": (0, 0, 35),
     "right_shoulder": (0, 0, -60), "left_shoulder": (0, 0, -60)},
    {"pelvis": (75, 0, 0), "left_hip": (-35, 0, 0), "right_hip": (-35, 0, 0),
     "spine1": (-8, 0, 0), "left_shoulder": (0, -50, 55), "right_shoulder": (0, 50, -55),
     "neck": (-15, 0, 0)},
)  # fmt: skip
FINGERS = ("index", "middle", "ring", "pinky")


def curled(side: str, degrees: float) -> Pose:
    """All four fingers bent by `degrees` at each knuckle."""
    sign = -1.0 if side == "left" else 1.0
    return {f"{side}_{f}{k}": (0, 0, sign * degrees) for f in FINGERS for k in (1, 2, 3)}


HANDS: tuple[Pose, ...] = (
    {}, curled("left", 25), curled("left", 70),
    {k: v for k, v in curled("left", 75).items() if "index" not in k},
    {k: v for k, v in curled("left", 75).items() if "index" not in k and "middle" not in k},
)  # fmt: skip


def tile(
    model: Model, pose: Pose, betas: torch.Tensor, centre: np.ndarray, height_m: float, yaw: float
) -> np.ndarray:
    """One posed body from `yaw` radians off its front; the picture is `height_m` high."""
    theta = torch.zeros(len(model.parents), 3, dtype=torch.float64)
    for joint, angles in pose.items():
        theta[model.joint_names.index(joint)] = torch.deg2rad(torch.tensor(angles).double())
    mesh = model.shape(betas).pose(exp(theta), torch.zeros(3).double()).mesh()
    colors = np.array([COLORS_BGR[name] for name in model.part_names], dtype=np.float64)
    width, height = TILE_PX
    distance = 6 * height_m
    focal = height * distance / height_m
    K = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1.0]])
    c, s = np.cos(yaw), np.sin(yaw)
    R = np.diag([1.0, -1.0, -1.0]) @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    t = np.array([0, 0, distance]) - R @ centre
    paper = np.full((height, width, 3), PAPER, dtype=np.uint8)
    assert model.face_parts is not None
    return draw_mesh(
        paper, mesh.vertices.numpy(), mesh.faces.numpy(), colors[model.face_parts.numpy()], K, R, t
    )


def picture() -> np.ndarray:
    """Four rows: ten poses in two, three shapes, and a hand of the 52-joint body."""
    body, hands = load_free_body(), load_free_body(hands=True)
    mean = torch.zeros(10, dtype=torch.float64)
    middle = np.array([0, 0.12, 0.0])
    poses = [tile(body, pose, mean, middle, 2.25, -0.55) for pose in POSES]
    shapes = []
    for values in ((2.0, -2.0, 0.0), (0.0, 0.0, 0.0), (-1.5, 0.5, -2.5)):
        betas = mean.clone()
        betas[:3] = torch.tensor(values)
        shapes.append(tile(body, ARMS_DOWN, betas, np.array([0, -0.1, 0.0]), 2.15, -0.4))
    hand = hands.joints_template[hands.joint_names.index("left_middle1")].numpy()
    close = [tile(hands, pose, mean, hand, 0.25, -0.3) for pose in HANDS]
    blank = np.full_like(poses[0], PAPER)
    rows = [poses[:5], poses[5:], [blank, *shapes, blank], close]
    return np.vstack([np.hstack(row) for row in rows])


def main() -> None:
    out = Path(sys.argv[1])
    cv2.imwrite(str(out), picture(), [cv2.IMWRITE_PNG_COMPRESSION, 9])
    print(f"{out}: {out.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
