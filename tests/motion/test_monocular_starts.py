"""Starts from an estimator: its missing joints and frames are bridged, never spread."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from imocap_core.body import load_free_body
from imocap_core.motion.monocular.starts import (
    MIN_JOINTS,
    Library,
    fit_rotations_to_joints,
    make_library,
    start_at_motion,
)
from imocap_core.motion.prior import load_pose_prior
from imocap_core.motion.state import Body
from imocap_core.rotations import exp, geodesic_angle


@pytest.fixture(scope="module")
def body() -> Body:
    return Body.of(load_free_body(), "body25")


@pytest.fixture(scope="module")
def library(body: Body) -> Library:
    rng = np.random.default_rng(0)
    return make_library(body, load_pose_prior(), rng, poses=40, directions=4)


def test_library_poses_are_found_again_from_the_joints_that_are_there(
    body: Body, library: Library
) -> None:
    rng = np.random.default_rng(1)
    turn = exp(torch.as_tensor(rng.normal(size=(5, 3))))
    joints = (library.joints[:5] @ turn.transpose(-1, -2)).numpy() + rng.normal(size=(5, 1, 3))
    joints[1, 3] = np.nan
    joints[2] = np.nan
    joints[3, MIN_JOINTS - 1 :] = np.nan
    found = fit_rotations_to_joints(body, library, joints)
    for t in (0, 1, 4):
        assert torch.allclose(found[t, 1:], library.R_local[t, 1:], atol=1e-6)
    apart = geodesic_angle(found[1], found[4])
    assert torch.allclose(geodesic_angle(found[1], found[2]), apart / 3, atol=1e-6)
    assert torch.allclose(geodesic_angle(found[3], found[4]), apart / 3, atol=1e-6)
    with pytest.raises(ValueError, match="no frame has 6 joints"):
        fit_rotations_to_joints(body, library, joints[2:4])


def test_missing_frames_of_a_motion_lie_between_their_neighbours() -> None:
    R_local = exp(torch.full((5, 24, 3), 0.1).double().cumsum(0))
    trans = torch.arange(15.0).double().reshape(5, 3)
    holed, path = R_local.clone(), trans.clone()
    holed[1, 7], path[3, 0] = torch.nan, torch.nan
    start = start_at_motion(holed, path)
    assert torch.allclose(start.R_local, R_local, atol=1e-9)
    assert torch.allclose(start.trans, trans)
    with pytest.raises(ValueError, match="every frame"):
        start_at_motion(holed[1:2], path[1:2])
