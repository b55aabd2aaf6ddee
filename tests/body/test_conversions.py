"""Laws of conversions: what turns a pose into another notation leaves the body where it was."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from imocap_core import rotations as so3
from imocap_core.body import conversions as convert
from imocap_core.body import load_free_body


def rotations(*leading: int) -> torch.Tensor:
    rng = np.random.default_rng(0)
    matrices = Rotation.random(int(np.prod(leading)), rng=rng).as_matrix()
    return torch.as_tensor(matrices.reshape(*leading, 3, 3))


def test_axis_angle_poses_round_trip_on_the_branch_of_a_reference() -> None:
    R_local = rotations(4, 24)
    theta = convert.pose_from_rotations(R_local)
    torch.testing.assert_close(convert.rotations_from_pose(theta), R_local)
    other = so3.nearest_branch(theta.unflatten(-1, (24, 3)), 9.0 + torch.zeros(4, 24, 3)).flatten(
        -2
    )
    torch.testing.assert_close(convert.pose_from_rotations(R_local, other), other)
    with pytest.raises(ValueError, match="3 J"):
        convert.rotations_from_pose(torch.zeros(2, 71))


def test_rh_th_and_global_orient_transl_place_the_same_body() -> None:
    rng = np.random.default_rng(1)
    model = load_free_body()
    rest = model.v_template + torch.tensor([0.1, -0.2, 0.05], dtype=torch.float64)
    pelvis = torch.as_tensor(rng.normal(size=3))
    R_global, Th = rotations(1)[0], torch.as_tensor(rng.normal(size=3))
    about_origin = rest @ R_global.T + Th
    transl = convert.transl_from_Th(R_global, Th, pelvis)
    about_pelvis = (rest - pelvis) @ R_global.T + pelvis + transl
    torch.testing.assert_close(about_pelvis, about_origin)
    torch.testing.assert_close(convert.Th_from_transl(R_global, transl, pelvis), Th)


def test_smpl_survives_the_trip_through_smplh_and_smplx() -> None:
    R_local = rotations(5, 24)
    there = convert.smplh_from_smpl(R_local)
    assert there.shape == (5, 52, 3, 3)
    torch.testing.assert_close(convert.smpl_from_smplh(there), R_local)
    torch.testing.assert_close(convert.smplh_from_smplx(convert.smplx_from_smplh(there)), there)


def test_body_joints_stay_when_fingers_are_added() -> None:
    """The 24-joint and the 52-joint free body agree on everything up to the wrists."""
    R_local = rotations(3, 24)
    shape = torch.as_tensor(np.random.default_rng(2).normal(size=10))
    transl = torch.zeros(3, 3, dtype=torch.float64)
    plain = load_free_body().shape(shape).pose(R_local, transl)
    full = load_free_body(hands=True).shape(shape).pose(convert.smplh_from_smpl(R_local), transl)
    torch.testing.assert_close(full.joints[:, :22], plain.joints[:, :22])


def test_hand_spaces_are_linear_and_absent_ones_are_named() -> None:
    with pytest.raises(ValueError, match="no hand space"):
        convert.hand_pose_from_pca(load_free_body(hands=True), "left", torch.zeros(6))
