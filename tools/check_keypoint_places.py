"""Offsets of a real detector's keypoints from their places in the body's layout.

    python tools/check_keypoint_places.py balance_beam/trc_reference.npz

Fits poses and one shape of the free body to triangulated BODY_25B detections (`xyz_zup_m`
(T, K, 3), `names`) and prints each keypoint's mean distance and its median offset in the frame of
its bone. A constant offset means that its place in data/layouts.toml is wrong.
"""

from __future__ import annotations

import sys

import numpy as np
import torch
from torch import Tensor

from imocap_core.body import Model, PointSet, Shaped, keypoints_with_jacobian, load_free_body
from imocap_core.rotations import exp, log

EVERY = 5  # frames
SCALE_M, ROBUST = 0.02, 3.0  # detection noise, and scale of the robust weights
STIFFNESS = {"spine": 6.0, "collar": 6.0, "hand": 30.0, "foot": 30.0, "pelvis": 0.0}  # else 0.9
SPELLED = {"Nose": "nose", "Neck": "upper_neck", "Head": "head_top"}
PARTS = {
    "Shoulder": "shoulder",
    "Elbow": "elbow",
    "Wrist": "wrist",
    "Hip": "hip",
    "Knee": "knee",
    "Ankle": "ankle",
    "BigToe": "big_toe",
    "SmallToe": "small_toe",
    "Heel": "heel",
}
SPELLED |= {
    s[0].upper() + part: f"{s}_{ours}" for s in ("left", "right") for part, ours in PARTS.items()
}
CARRIED_BY = {
    "hip": "pelvis",
    "shoulder": "spine3",
    "knee": "{}_hip",
    "elbow": "{}_shoulder",
    "wrist": "{}_elbow",
    "ankle": "{}_ankle",
    "toe": "{}_ankle",
    "heel": "{}_ankle",
}


def carrier(name: str) -> str:
    """The joint in whose frame the offset of this keypoint is printed."""
    side = name.partition("_")[0]
    joints = [joint for part, joint in CARRIED_BY.items() if name.endswith(part)]
    return joints[0].format(side) if joints else "head"


def start(model: Model, xyz: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
    """Orientation and position of the detected trunk, limbs as in the T pose."""
    across = xyz["left_hip"] - xyz["right_hip"]
    up = xyz["left_shoulder"] + xyz["right_shoulder"] - xyz["left_hip"] - xyz["right_hip"]
    x = torch.nn.functional.normalize(across, dim=-1)
    z = torch.nn.functional.normalize(torch.linalg.cross(x, up, dim=-1), dim=-1)
    R_local = torch.eye(3).double().repeat(len(x), len(model.parents), 1, 1)
    R_local[:, 0] = torch.stack((x, torch.linalg.cross(z, x, dim=-1), z), dim=-1)
    return R_local, (xyz["left_hip"] + xyz["right_hip"]) / 2


def fit(
    model: Model,
    points: PointSet,
    columns: list[int],
    detected: Tensor,
    R_local: Tensor,
    transl: Tensor,
) -> tuple[Shaped, Tensor, Tensor]:
    """Robust Gauss-Newton over all poses and one shape; detected (T, K, 3), NaN where missing."""
    frames, betas = len(detected), torch.zeros(10).double()
    here = torch.isfinite(detected).flatten(1)
    target = torch.nan_to_num(detected).flatten(1)
    names = model.joint_names
    stiff = [next((v for k, v in STIFFNESS.items() if k in n), 0.9) for n in names]
    pull = torch.tensor([*np.repeat(stiff, 3), 0, 0, 0]).double()
    by_transl = torch.eye(3).double().repeat(len(columns), 1).expand(frames, -1, 3)
    for _ in range(60):
        xyz, d_pose, d_beta = keypoints_with_jacobian(model.shape(betas), points, R_local, transl)
        residual = here * (xyz[:, columns].flatten(1) - target) / SCALE_M
        weight = (here / (1 + (residual / ROBUST) ** 2))[..., None]
        pose = torch.cat((d_pose[:, columns].flatten(1, 2), by_transl), dim=-1) / SCALE_M
        shape = d_beta[:, columns].flatten(1, 2) / SCALE_M
        theta = torch.cat((log(R_local).flatten(1), torch.zeros_like(transl)), dim=-1)
        inverse = torch.linalg.inv(pose.mT @ (weight * pose) + torch.diag(pull + 1e-3))
        cross = pose.mT @ (weight * shape)
        slope = (pose.mT @ (weight * residual[..., None]))[..., 0] + pull * theta
        reduced = (shape.mT @ (weight * shape) - cross.mT @ inverse @ cross).sum(0)
        slope_beta = (shape.mT @ (weight * residual[..., None])).sum(0)[:, 0] + 5 * betas
        slope_beta = slope_beta - (cross.mT @ (inverse @ slope[..., None])).sum(0)[:, 0]
        step_beta = -torch.linalg.solve(reduced + 5 * torch.eye(10).double(), slope_beta)
        step = -(inverse @ (slope + cross @ step_beta)[..., None])[..., 0]
        R_local = R_local @ exp(step[:, :72].unflatten(-1, (24, 3)).clamp(-0.5, 0.5))
        transl, betas = transl + step[:, 72:], betas + step_beta
    return model.shape(betas), R_local, transl


def main() -> None:
    with np.load(sys.argv[1]) as data:
        zup = torch.as_tensor(data["xyz_zup_m"][::EVERY])
        names = [SPELLED[str(name)] for name in data["names"]]
    detected = zup[..., [1, 2, 0]]  # y up, still right-handed
    model = load_free_body()
    points = model.points("body25b")
    columns = [points.names.index(name) for name in names]
    first = {name: detected[:, k] for k, name in enumerate(names)}
    shaped, R_local, transl = fit(model, points, columns, detected, *start(model, first))
    posed = shaped.pose(R_local, transl)
    offset_mm = 1000 * (detected - posed.keypoints(points)[:, columns])
    print(f"all keypoints: {offset_mm.square().sum(-1).nanmean().sqrt():.1f} mm RMS")
    for k, name in enumerate(names):
        R_world = posed.R_world[:, model.joint_names.index(carrier(name))]
        local = (R_world.mT @ offset_mm[:, k, :, None])[..., 0].nanmedian(dim=0).values
        distance = offset_mm[:, k].norm(dim=-1).nanmean()
        left, up, ahead = local.tolist()
        print(f"{name:18s} {distance:5.1f} mm; left {left:4.0f}, up {up:4.0f}, ahead {ahead:4.0f}")


if __name__ == "__main__":
    main()
