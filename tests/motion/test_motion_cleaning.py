"""Feet in contact stay where they stand, hands end above the ground, and nothing else changes."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from imocap_core.body import load_free_body
from imocap_core.camera.ground_plane import Ground
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.hands_on_ground import CLEARANCE_M, hands_on_ground, rest_hand
from imocap_core.motion.motion_cleaning import (
    LockedFeet,
    Span,
    faded,
    leg_to,
    lock_feet,
    shortest_arc,
    spans_of,
)
from imocap_core.rotations import exp

FPS, T = 30.0, 90
LEGS = [SMPL_JOINTS.index(f"{s}_{p}") for s in ("left", "right") for p in ("hip", "knee", "ankle")]
FEET = [SMPL_JOINTS.index(f"{s}_{p}") for s in ("left", "right") for p in ("ankle", "foot")]
BODY = load_free_body()
SHAPED = BODY.shape(torch.zeros(10, dtype=torch.float64))


def joints_of(R: np.ndarray, path: np.ndarray) -> np.ndarray:
    return SHAPED.pose(torch.as_tensor(R), torch.as_tensor(path)).joints.numpy()


def crouching(noise_rad: float, lift: slice | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Knees bent, feet flat on a ground at 0, legs that tremble; the left one steps aside."""
    vectors = np.zeros((T, 24, 3))
    for hip, knee, ankle in (LEGS[:3], LEGS[3:]):
        vectors[:, hip, 0], vectors[:, knee, 0], vectors[:, ankle, 0] = -0.5, 0.9, -0.4
    if lift is not None:
        swing = np.sin(np.linspace(0, np.pi, lift.stop - lift.start))
        vectors[lift, LEGS[0], 0] -= 0.5 * swing
        vectors[lift, LEGS[1], 0] += 0.9 * swing
    trembling = gaussian_filter1d(np.random.default_rng(1).normal(size=(T, 24, 3)), 6.0, axis=0)
    vectors[:, LEGS] += noise_rad * trembling[:, LEGS]
    R = Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix().reshape(T, 24, 3, 3)
    low = joints_of(R, np.zeros((T, 3)))[:, FEET, 1].min()
    return R, np.tile([0.0, 0.02 - low, 0.0], (T, 1))


def locked(R: np.ndarray, path: np.ndarray) -> tuple[LockedFeet, np.ndarray, np.ndarray]:
    before = joints_of(R, path)
    done = lock_feet(R, before, BODY.parents, before[..., 1], FPS)
    return done, before, joints_of(done.R_local, path)


def test_feet_that_stand_do_not_move_at_all() -> None:
    done, before, after = locked(*crouching(0.02))
    assert done.contact.all()
    assert np.abs(np.diff(before[:, FEET], axis=0)).max() > 2e-4
    assert np.abs(np.diff(after[:, FEET], axis=0)).max() < 1e-7
    assert np.linalg.norm(after - before, axis=-1).max() < 0.03
    assert done.reached.all()


def test_all_but_the_legs_stays_as_it_is() -> None:
    R, path = crouching(0.02)
    done, before, after = locked(R, path)
    others = [j for j in range(24) if j not in LEGS]
    np.testing.assert_array_equal(done.R_local[:, others], R[:, others])
    upper = [0, *range(12, 24)]
    np.testing.assert_allclose(after[:, upper], before[:, upper], atol=1e-12)


def test_a_motion_with_still_feet_stays_as_it_is() -> None:
    R, path = crouching(0.0)
    done, _, _ = locked(R, path)
    np.testing.assert_allclose(done.R_local, R, atol=1e-7)


def test_a_step_is_free_and_leaves_and_comes_smoothly() -> None:
    lift = slice(30, 60)
    done, before, after = locked(*crouching(0.02, lift))
    left, right = FEET[:2], FEET[2:]
    assert not done.contact[42:48, :2].any()
    assert done.contact[:, 2:].all()
    assert np.abs(np.diff(after[:, right], axis=0)).max() < 1e-7
    stands = done.contact[:, 1]
    assert np.abs(np.diff(after[:, left[1]], axis=0)[stands]).max() < 1e-7
    jerk = [np.abs(np.diff(x[:, left], n=2, axis=0)).max() for x in (before, after)]
    assert jerk[1] < 2 * jerk[0]
    middle = np.linalg.norm((after - before)[42:48, left], axis=-1)
    assert middle.max() < 0.01


def test_feet_in_the_air_are_not_locked() -> None:
    R, path = crouching(0.02)
    done, before, after = locked(R, path + [0.0, 0.5, 0.0])
    assert not done.contact.any()
    np.testing.assert_array_equal(after, before)


def test_a_leg_reaches_and_keeps_its_lengths() -> None:
    rng = np.random.default_rng(2)
    hip, thigh, shin = rng.normal(size=(3, 50, 3))
    knee = hip + 0.4 * thigh / np.linalg.norm(thigh, axis=1, keepdims=True)
    ankle = knee + 0.38 * shin / np.linalg.norm(shin, axis=1, keepdims=True)
    back = np.tile([0.0, 0.0, -1.0], (50, 1))
    ahead = rng.normal(size=(50, 3))
    place = hip + rng.uniform(0.1, 0.77, (50, 1)) * ahead / np.linalg.norm(ahead, axis=1)[:, None]
    turns = leg_to(hip, knee, ankle, place, back)
    bent = hip + np.einsum("tij,tj->ti", turns.thigh, knee - hip)
    end = bent + np.einsum("tij,tj->ti", turns.shin, ankle - knee)
    np.testing.assert_allclose(end, place, atol=1e-7)
    assert turns.reached.all()
    same = leg_to(hip, knee, ankle, ankle, back)
    np.testing.assert_allclose(same.thigh, np.tile(np.eye(3), (50, 1, 1)), atol=1e-7)
    np.testing.assert_allclose(same.shin, np.tile(np.eye(3), (50, 1, 1)), atol=1e-6)
    far = leg_to(hip, knee, ankle, hip + 2 * (place - hip) + (place - hip), back)
    assert far.reached.sum() == (3 * np.linalg.norm(place - hip, axis=1) < 0.78).sum()


def test_the_shortest_arc_is_the_smallest_turn() -> None:
    a, b = np.random.default_rng(3).normal(size=(2, 20, 3))
    R = shortest_arc(a, b)
    unit_a, unit_b = (x / np.linalg.norm(x, axis=1, keepdims=True) for x in (a, b))
    np.testing.assert_allclose(np.einsum("tij,tj->ti", R, unit_a), unit_b, atol=1e-12)
    angle = np.arccos((unit_a * unit_b).sum(1))
    np.testing.assert_allclose(Rotation.from_matrix(R).magnitude(), angle, atol=1e-7)


def test_short_gaps_are_closed_and_short_contacts_left_out() -> None:
    contact = np.zeros(60, dtype=bool)
    contact[[*range(5, 20), *range(21, 30), *range(50, 53)]] = True
    path = np.zeros((61, 3))
    assert spans_of(contact, path, FPS) == [Span(5, 30)]
    path[:8, 0] = 0.05  # not yet where it stands
    assert spans_of(contact, path, FPS) == [Span(8, 30)]
    assert spans_of(np.zeros(60, dtype=bool), path, FPS) == []


@pytest.mark.parametrize("fade", [1, 5, 40])
def test_a_correction_fades_to_nothing(fade: int) -> None:
    anchored = np.zeros(40, dtype=bool)
    anchored[15:20] = True
    filled = faded(np.where(anchored[:, None], [2.0, -1.0], 7.0), anchored, fade)
    np.testing.assert_array_equal(filled[anchored], [[2.0, -1.0]] * 5)
    assert np.all(np.diff(filled[:, 0])[19:] <= 0)
    beyond = np.abs(np.arange(40) - 17) >= 2 + fade
    np.testing.assert_array_equal(filled[beyond], 0)


FRAMES = 30
SIDES = ("left", "right")
WRISTS = [SMPL_JOINTS.index(f"{side}_wrist") for side in SIDES]
HANDS = [SMPL_JOINTS.index(f"{side}_hand") for side in SIDES]
UP = np.array([0.1, -0.98, 0.2]) / np.linalg.norm([0.1, -0.98, 0.2])


@pytest.fixture(scope="module")
def motion() -> tuple[np.ndarray, np.ndarray]:
    theta = torch.from_numpy(np.random.default_rng(2).normal(0, 0.4, (FRAMES, 24, 3)))
    R_local = exp(theta).numpy()
    return R_local, joints_of(R_local, np.zeros(3))


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
    np.testing.assert_allclose(joints, joints_of(R_local, np.zeros(3)), atol=1e-9)
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
    joints = joints_of(R_local, np.zeros(3))
    down = R_local[0, SMPL_JOINTS.index("left_shoulder")] @ hand.direction
    back = -(R_local[0, SMPL_JOINTS.index("left_shoulder")] @ hand.palm)
    assert down @ up < -0.9
    ground = Ground(up, joints[0, WRISTS[0]] - 0.03 * up, 1.0, 10.0)
    _, moved = hands_on_ground(BODY, R_local, joints, ground)
    along = moved[0, HANDS[0]] - moved[0, WRISTS[0]]
    assert along @ back > 0.9 * np.linalg.norm(along)
