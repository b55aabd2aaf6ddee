"""One camera from all frames: exact without noise, robust with it, honest when it fails."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.camera.averaging import angle_deg
from imocap_core.camera.pnp import pnp_over_frames
from imocap_core.camera.projection import intrinsics, project

K = intrinsics(640.0, (640, 360))


def filmed(rng, frames=60, joints=17):
    """A cloud of the size of a person that wanders about half a metre and changes its shape, a
    camera, and its picture."""
    path = np.cumsum(rng.normal(size=(frames, 1, 3)) * [0.03, 0.005, 0.03], axis=0)
    shape = rng.normal(size=(1, joints, 3)) * [0.2, 0.45, 0.15]
    x_world = path + shape + 0.05 * rng.normal(size=(frames, joints, 3))
    turns_deg = [rng.uniform(-170, 170), rng.uniform(-20, 20)]
    R = Rotation.from_euler("yx", turns_deg, degrees=True).as_matrix()
    t = np.array([0.2, 0.1, 4.5])
    return x_world, R, t, project(x_world, K, R, t)


def turned(R, degrees, rng):
    axis = rng.normal(size=3)
    return R @ Rotation.from_rotvec(np.deg2rad(degrees) * axis / np.linalg.norm(axis)).as_matrix()


@pytest.mark.parametrize("seed", range(5))
def test_without_noise_the_camera_is_exact_from_a_start_20_degrees_off(seed):
    rng = np.random.default_rng(seed)
    x_world, R, t, xy_px = filmed(rng)
    estimate = pnp_over_frames(x_world, xy_px, np.ones(xy_px.shape[:2]), K, turned(R, 20.0, rng))
    assert estimate.ok, estimate.status
    assert angle_deg(estimate.R, R) < 1e-3
    assert np.allclose(estimate.t, t, atol=1e-4)


@pytest.mark.parametrize("seed", range(5))
def test_with_noise_and_a_third_of_the_frames_mismatched(seed):
    rng = np.random.default_rng(seed)
    x_world, R, t, xy_px = filmed(rng, frames=90)
    xy_px += 4.0 * rng.normal(size=(90, 17, 2))
    xy_px[:30] = xy_px[60:90] + rng.normal(size=(30, 1, 2)) * 60.0
    xy_px[rng.random((90, 17)) < 0.05] = np.nan
    confidence = rng.uniform(0.3, 1.0, size=(90, 17))
    estimate = pnp_over_frames(x_world, xy_px, confidence, K, turned(R, 12.0, rng))
    assert angle_deg(estimate.R, R) < 1.5
    assert np.linalg.norm(estimate.t - t) < 0.12
    assert estimate.median_px < 10.0


def test_a_refinement_that_leaves_the_basin_is_refused():
    rng = np.random.default_rng(4)
    x_world, R, _, xy_px = filmed(rng)
    start = turned(R, 20.0, rng)
    estimate = pnp_over_frames(x_world, xy_px, np.ones(xy_px.shape[:2]), K, start, max_turn_deg=5.0)
    assert np.array_equal(estimate.R, start)
    assert "its start is returned" in estimate.status


def test_the_camera_moves_with_the_world():
    rng = np.random.default_rng(6)
    x_world, R, _, xy_px = filmed(rng)
    xy_px += rng.normal(size=(60, 17, 2))
    G = Rotation.random(rng=rng).as_matrix()
    shift = np.array([1.0, -2.0, 0.5])
    ones = np.ones(xy_px.shape[:2])
    plain = pnp_over_frames(x_world, xy_px, ones, K, R)
    moved = pnp_over_frames(x_world @ G.T + shift, xy_px, ones, K, R @ G.T)
    assert angle_deg(moved.R, plain.R @ G.T) < 0.02
    assert np.allclose(moved.t, plain.t - moved.R @ shift, atol=5e-3)


def test_too_few_points_is_a_status_not_an_exception():
    nowhere = np.full((2, 5, 3), np.nan)
    empty = pnp_over_frames(nowhere, nowhere[..., :2], np.ones((2, 5)), K, np.eye(3))
    assert not empty.ok
    assert "0 usable points" in empty.status


def test_wrong_shapes_are_named():
    with pytest.raises(ValueError, match=r"x_world \(T, J, 3\)"):
        pnp_over_frames(np.zeros((2, 5, 3)), np.zeros((2, 4, 2)), np.ones((2, 5)), K, np.eye(3))
