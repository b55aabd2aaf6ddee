"""Wrong starts are what they are called, and recovered is what is within 5 %."""

import numpy as np
import pytest
import torch

from benchmarks.wrong_start.wrong_fit import depth_reversed, facing_reversed
from imocap_core.artifacts.schemas import VideoMotion
from imocap_core.body import load_free_body
from imocap_core.conventions import SMPL_JOINTS, mirror_indices
from imocap_core.rotations import exp, log

FRAMES = 4


def motion() -> VideoMotion:
    """Some poses that face the camera, the root at the origin."""
    rng = np.random.default_rng(3)
    theta = rng.normal(0, 0.2, (FRAMES, 72))
    theta[:, :3] = [np.pi, 0.0, 0.0]
    return VideoMotion(
        id="v1",
        frames=np.arange(FRAMES),
        theta=theta,
        betas=np.zeros(10),
        trans=np.zeros((FRAMES, 3)),
        joints=joints_of(exp(torch.as_tensor(theta).reshape(-1, 24, 3))),
        reprojection_px=np.zeros(FRAMES),
    )


def joints_of(R_local: torch.Tensor) -> np.ndarray:
    """(T, 24, 3) about the root."""
    shaped = load_free_body().shape(torch.zeros(1, 10, dtype=torch.float64))
    joints = shaped.pose(R_local, torch.zeros(len(R_local), 3, dtype=torch.float64)).joints
    return (joints - joints[:, :1]).numpy()


@pytest.mark.parametrize("sides_swapped", [False, True])
def test_reversing_the_facing_twice_changes_nothing(sides_swapped: bool) -> None:
    first = motion()
    once = facing_reversed(first, sides_swapped=sides_swapped)
    again = first.model_copy(update={"theta": log(once).flatten(1).numpy()})
    twice = facing_reversed(again, sides_swapped=sides_swapped)
    np.testing.assert_allclose(joints_of(twice), first.joints, atol=1e-9)


def test_the_swap_of_sides_is_the_mirror_image_in_depth() -> None:
    reversed_m = joints_of(facing_reversed(motion(), sides_swapped=True))
    twins = list(mirror_indices(SMPL_JOINTS))
    expected = (motion().joints * np.array([1.0, 1.0, -1.0]))[:, twins]
    # the free body's left and right are alike within a few millimetres
    np.testing.assert_allclose(reversed_m, expected, atol=5e-3)


def test_depth_is_reversed_about_the_root_and_the_picture_stays() -> None:
    joints = motion().joints + np.array([0.0, 0.0, 4.0])
    reversed_m = depth_reversed(joints)
    np.testing.assert_array_equal(reversed_m[..., :2], joints[..., :2])
    np.testing.assert_allclose(reversed_m[..., 2] + joints[..., 2], 8.0, atol=1e-9)
