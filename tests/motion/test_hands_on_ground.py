"""Hands end above the ground; whatever is above it already stays as it is."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from imocap_core.body import load_free_body
from imocap_core.camera.ground_plane import Ground
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.hands_on_ground import CLEARANCE_M, hands_on_ground, rest_hand
from imocap_core.rotations import exp

BODY = load_free_body()
FRAMES = 30
SIDES = ("left", "right")
WRISTS = [SMPL_JOINTS.index(f"{side}_wrist") for side in SIDES]
HANDS = [SMPL_JOINTS.index(f"{side}_hand") for side in SIDES]
UP = np.array([0.1, -0.98, 0.2]) / np.linalg.norm([0.1, -0.98, 0.2])


def joints_of(R_local: np.ndarray) -> np.ndarray:
    zero = torch.zeros(10).double()
    posed = BODY.shape(zero).pose(torch.from_numpy(R_local), zero[:3])
    return np.asarray(posed.joints.numpy())


@pytest.fixture(scope="module")
def motion() -> tuple[np.ndarray, np.ndarray]:
    theta = torch.from_numpy(np.random.default_rng(2).normal(0, 0.4, (FRAMES, 24, 3)))
    R_local = exp(theta).numpy()
    return R_local, joints_of(R_local)


def ground_below_wrists(joints: np.ndarray, height_m: float) -> Ground:
    lowest = (joints[:, WRISTS] @ UP).min()
    return Ground(UP, (lowest - height_m) * UP, 1.0, 10.0)


def tips_m(R_local: np.ndarray, joints: np.ndarray, ground: Ground) -> np.ndarray:
    """Heights (T, 2) of the hands' tips."""
    heights = []
    for side, wrist in zip(SIDES, WRISTS, strict=True):
        hand = rest_hand(BODY, side)
        at_rest = BODY.joints_template.numpy()
        along = joints[:, wrist + 2] - joints[:, wrist]
        scale = hand.length_m / np.linalg.norm(at_rest[wrist + 2] - at_rest[wrist])
        heights.append(ground.height_m(joints[:, wrist] + scale * along))
    return np.stack(heights, axis=1)


def test_a_hand_that_would_be_below_ends_above(motion: tuple[np.ndarray, np.ndarray]) -> None:
    ground = ground_below_wrists(motion[1], 0.02)
    assert tips_m(*motion, ground).min() < -0.05
    lifted = hands_on_ground(BODY, *motion, ground)
    assert tips_m(*lifted, ground).min() > CLEARANCE_M - 1e-9


def test_only_wrists_turn_and_joints_agree_with_them(motion: tuple[np.ndarray, np.ndarray]) -> None:
    R_local, joints = hands_on_ground(BODY, *motion, ground_below_wrists(motion[1], 0.0))
    changed = np.flatnonzero(np.abs(R_local - motion[0]).max(axis=(0, 2, 3)) > 1e-12)
    assert changed.tolist() == WRISTS
    np.testing.assert_allclose(joints, joints_of(R_local), atol=1e-9)
    others = [j for j in range(24) if j not in HANDS]
    np.testing.assert_array_equal(joints[:, others], motion[1][:, others])


def test_who_stands_high_enough_is_not_touched(motion: tuple[np.ndarray, np.ndarray]) -> None:
    R_local, _ = hands_on_ground(BODY, *motion, ground_below_wrists(motion[1], 0.3))
    np.testing.assert_allclose(R_local, motion[0], atol=1e-12)


def test_twice_is_once(motion: tuple[np.ndarray, np.ndarray]) -> None:
    ground = ground_below_wrists(motion[1], 0.02)
    once = hands_on_ground(BODY, *motion, ground)
    twice = hands_on_ground(BODY, *once, ground)
    np.testing.assert_allclose(twice[0], once[0], atol=1e-6)


@pytest.mark.parametrize("sd_mm", [np.nan, 100.0])
def test_an_unknown_ground_moves_nothing(motion, sd_mm):
    ground = replace(ground_below_wrists(motion[1], 0.0), height_sd_mm=sd_mm)
    np.testing.assert_array_equal(hands_on_ground(BODY, *motion, ground)[0], motion[0])


def test_a_hand_that_points_straight_down_extends(motion: tuple[np.ndarray, np.ndarray]) -> None:
    """A plank: arms down from level shoulders, the back of the hand ahead; the fingers go there."""
    up = np.array([0.0, 1.0, 0.0])
    hand = rest_hand(BODY, "left")
    R_local = np.tile(np.eye(3), (1, 24, 1, 1))
    axis = torch.tensor([0.0, 0.0, -np.pi / 2])  # the left arm from the side straight down
    R_local[:, SMPL_JOINTS.index("left_shoulder")] = exp(axis.double()).numpy()
    joints = joints_of(R_local)
    down = R_local[0, SMPL_JOINTS.index("left_shoulder")] @ hand.direction
    back = -(R_local[0, SMPL_JOINTS.index("left_shoulder")] @ hand.palm)
    assert down @ up < -0.9
    ground = Ground(up, joints[0, WRISTS[0]] - 0.03 * up, 1.0, 10.0)
    _, moved = hands_on_ground(BODY, R_local, joints, ground)
    along = moved[0, HANDS[0]] - moved[0, WRISTS[0]]
    assert along @ back > 0.9 * np.linalg.norm(along)
