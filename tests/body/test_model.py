"""Laws of the stages: agreement with the slow twin, broadcasting, and the derivatives."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from imocap_core.body import (
    Model,
    PointSet,
    join_points,
    keypoints_with_jacobian,
    load_free_body,
    make_points,
)
from imocap_core.body import model as convert
from imocap_core.rotations import exp, right_jacobian
from tests.body.bodies import made_body, rodrigues_naive, skin_naive


def points_of(model: Model) -> PointSet:
    """A joint, a vertex, a mix of joints, and a mix of both."""
    return make_points(
        model,
        ("joint", "vertex", "joints", "mix"),
        ({3: 1.0}, {}, {2: 0.3, 6: 0.7}, {0: 0.5}),
        ({}, {7: 1.0}, {}, {1: 0.2, 9: 0.3}),
    )


def pose_of(
    rng: np.random.Generator, *leading: int, joints: int = 7
) -> tuple[torch.Tensor, torch.Tensor]:
    return torch.as_tensor(rng.normal(size=(*leading, joints, 3))), torch.as_tensor(
        rng.normal(size=(*leading, 3))
    )


@pytest.mark.parametrize(("dtype", "bound_m"), [(torch.float64, 1e-10), (torch.float32, 1e-5)])
def test_agrees_with_the_published_formulas(dtype, bound_m):
    rng = np.random.default_rng(0)
    model = made_body(rng, dtype=dtype)
    theta, transl = pose_of(rng)
    betas = rng.normal(size=10)
    rotations = np.stack([rodrigues_naive(a) for a in theta.numpy()])
    vertices, joints = skin_naive(model, betas, rotations, transl.numpy())
    posed = model.shape(torch.as_tensor(betas, dtype=dtype)).pose(
        exp(theta.to(dtype)), transl.to(dtype)
    )
    assert np.abs(posed.mesh().vertices.numpy() - vertices).max() < bound_m
    assert np.abs(posed.joints.numpy() - joints).max() < bound_m
    mixed = 0.5 * joints[0] + 0.2 * vertices[1] + 0.3 * vertices[9]
    expected = np.stack([joints[3], vertices[7], 0.3 * joints[2] + 0.7 * joints[6], mixed])
    assert np.abs(posed.keypoints(points_of(model)).numpy() - expected).max() < bound_m


@pytest.mark.parametrize("betas_leading", [(), (1,), (2, 1), (1, 5), (2, 5)])
def test_leading_axes_broadcast(betas_leading: tuple[int, ...]) -> None:
    rng = np.random.default_rng(1)
    model = made_body(rng)
    points = points_of(model)
    theta, transl = pose_of(rng, 2, 5)
    betas = torch.as_tensor(rng.normal(size=(*betas_leading, 10)))
    shaped = model.shape(betas)
    xyz, d_pose, d_shape = keypoints_with_jacobian(shaped, points, exp(theta), transl)
    posed = shaped.pose(exp(theta), transl)
    every = betas.expand(2, 5, 10)
    for v in range(2):
        for t in range(5):
            alone = model.shape(every[v, t])
            single = keypoints_with_jacobian(alone, points, exp(theta[v, t]), transl[v, t])
            for many, one in zip((xyz, d_pose, d_shape), single, strict=True):
                torch.testing.assert_close(many[v, t], one)
            pose = alone.pose(exp(theta[v, t]), transl[v, t])
            torch.testing.assert_close(posed.joints[v, t], pose.joints)
            torch.testing.assert_close(posed.mesh().vertices[v, t], pose.mesh().vertices)
            torch.testing.assert_close(posed.keypoints(points)[v, t], single[0])


def test_derivatives_equal_automatic_ones_in_axis_angle() -> None:
    rng = np.random.default_rng(3)
    model = made_body(rng)
    points = points_of(model)
    theta, transl = pose_of(rng)
    betas = torch.as_tensor(rng.normal(size=10))
    _, d_pose, d_shape = keypoints_with_jacobian(model.shape(betas), points, exp(theta), transl)

    def place(theta: torch.Tensor, betas: torch.Tensor) -> torch.Tensor:
        return model.shape(betas).pose(exp(theta), transl).keypoints(points)

    by_theta, by_betas = torch.autograd.functional.jacobian(place, (theta, betas))
    d_theta = torch.einsum("kcji,jia->kcja", d_pose.unflatten(-1, (7, 3)), right_jacobian(theta))
    torch.testing.assert_close(d_theta, by_theta, atol=1e-12, rtol=1e-12)
    torch.testing.assert_close(d_shape, by_betas, atol=1e-12, rtol=1e-12)


def test_joined_sets_of_points_answer_like_each_alone() -> None:
    rng = np.random.default_rng(6)
    model = made_body(rng)
    joints_only = make_points(model, ("a", "b"), ({1: 1.0}, {4: 1.0}), ({}, {}))
    sets = [points_of(model), joints_only, points_of(model)]
    theta, transl = pose_of(rng, 3)
    shaped = model.shape(torch.as_tensor(rng.normal(size=10)))
    whole = keypoints_with_jacobian(shaped, join_points(sets), exp(theta), transl)
    parts = [keypoints_with_jacobian(shaped, points, exp(theta), transl) for points in sets]
    for i, result in enumerate(whole):
        torch.testing.assert_close(result, torch.cat([part[i] for part in parts], dim=1))
    assert join_points(sets[:1]) is sets[0]
    with pytest.raises(ValueError, match="at least one"):
        join_points([])


def test_a_point_that_would_not_move_with_the_body_is_refused() -> None:
    model = made_body(np.random.default_rng(4))
    with pytest.raises(ValueError, match="sum to 1"):
        make_points(model, ("half",), ({0: 0.5},), ({},))


def test_misuse_says_what_was_expected() -> None:
    model = made_body(np.random.default_rng(5))
    with pytest.raises(ValueError, match="at most 10"):
        model.shape(torch.zeros(11, dtype=torch.float64))
    with pytest.raises(ValueError, match=r"expected \(\.\.\., 7, 3, 3\)"):
        model.shape(torch.zeros(10, dtype=torch.float64)).pose(torch.eye(3), torch.zeros(3))


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
