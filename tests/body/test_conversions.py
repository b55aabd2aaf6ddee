"""Laws of conversions: what turns a pose into another notation leaves the body where it was."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from imocap_core.body import load_free_body
from imocap_core.body import model as convert


def rotations(*leading: int) -> torch.Tensor:
    rng = np.random.default_rng(0)
    matrices = Rotation.random(int(np.prod(leading)), rng=rng).as_matrix()
    return torch.as_tensor(matrices.reshape(*leading, 3, 3))


def test_axis_angle_poses_round_trip() -> None:
    R_local = rotations(4, 24)
    theta = convert.pose_from_rotations(R_local)
    torch.testing.assert_close(convert.rotations_from_pose(theta), R_local)
    with pytest.raises(ValueError, match="3 J"):
        convert.rotations_from_pose(torch.zeros(2, 71))


def test_body_joints_stay_when_fingers_are_added() -> None:
    """The 24-joint and the 52-joint free body agree on everything up to the wrists."""
    R_local = rotations(3, 24)
    shape = torch.as_tensor(np.random.default_rng(2).normal(size=10))
    transl = torch.zeros(3, 3, dtype=torch.float64)
    plain = load_free_body().shape(shape).pose(R_local, transl)
    full = load_free_body(hands=True).shape(shape).pose(convert.smplh_from_smpl(R_local), transl)
    torch.testing.assert_close(full.joints[:, :22], plain.joints[:, :22])
