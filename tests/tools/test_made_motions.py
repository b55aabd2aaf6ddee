"""Motions made for the prior and the lifter: contacts hold, legs are straight, sides mirror."""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))
from lifter import anatomy
from lifter.anatomy import J, Pose, about, from_rotvec
from lifter.arms import Draw, hanging
from lifter.exercises import squat, stand
from lifter.made_motions import mirror_image, perform
from lifter.motions import with_straight_legs

ANKLES = [J["left_ankle"], J["right_ankle"]]


def _places(theta: np.ndarray, trans: np.ndarray) -> np.ndarray:
    """(N, T, 24, 3) of all joints, z up."""
    flat = Pose(from_rotvec(theta.reshape(-1, 24, 3).astype(float)), trans.reshape(-1, 3))
    return flat.posed()[1].reshape(*theta.shape[:2], 24, 3)


def test_people_stand_straight_and_balanced_over_flat_feet() -> None:
    d = Draw(np.random.default_rng(0), 50)
    goals = stand(d, hanging(d))
    pose = anatomy.pose_of(goals)
    _, xyz = pose.posed()
    knees = np.degrees(anatomy.rotvec(pose.R_local[:, [4, 5]]))[..., 0]
    assert np.median(knees) < 8
    np.testing.assert_allclose(xyz[:, ANKLES, 1], anatomy.SOLE, atol=0.01)
    off = anatomy.centre_of_mass(xyz)[:, 2] - xyz[:, ANKLES, 2].mean(1)
    assert (np.abs(off - 0.04) < 0.08).all()
    assert anatomy.plausible(pose).mean() > 0.8


def test_squatting_feet_stay_and_thighs_go_ahead() -> None:
    moved = perform("squat", 12, np.random.default_rng(1), 24, 8.0)
    xyz = _places(moved.theta, moved.trans)
    ankles = xyz[:, :, ANKLES]
    spread = np.linalg.norm(ankles[..., :2] - ankles[:, :1, :, :2], axis=-1)
    assert np.quantile(spread, 0.95) < 0.03
    d = Draw(np.random.default_rng(2), 30)
    _, low = squat(d)
    _, places = anatomy.pose_of(low).posed()
    ahead = places[:, [J["left_knee"], J["right_knee"]], 2] - places[:, [1, 2], 2]
    assert (ahead > 0).mean() > 0.95


def test_hands_stay_on_the_floor_in_push_ups() -> None:
    moved = perform("push_up", 8, np.random.default_rng(3), 24, 8.0)
    wrists = _places(moved.theta, moved.trans)[:, :, [J["left_wrist"], J["right_wrist"]]]
    assert np.median(np.ptp(wrists[..., 2], axis=1)) < 0.05


def test_a_seed_makes_the_same_motions_and_two_mirrors_are_none() -> None:
    a, b = (perform("kick", 6, np.random.default_rng(4), 6, 3.0) for _ in range(2))
    np.testing.assert_array_equal(a.theta, b.theta)
    np.testing.assert_allclose(mirror_image(mirror_image(a.theta)), a.theta)


def test_straightened_legs_keep_feet_and_their_direction() -> None:
    theta = np.zeros((40, 24, 3))
    bend = np.radians(35 + 30 * np.sin(np.linspace(0, 6, 40)) ** 2)
    for side in (0, 1):
        theta[:, 1 + side, 0], theta[:, 4 + side, 0] = -bend / 2, bend
        theta[:, 7 + side, 0] = -bend / 2
    theta[:, 0] = anatomy.rotvec(about("x", np.array(90.0)))
    clip = (theta, np.zeros((40, 3)) + (0, 0, 0.8))
    straight = with_straight_legs(clip)
    knees = np.degrees(straight[0][:, 4, 0])
    assert 2 < knees.min() < 10
    poses = [Pose(from_rotvec(t), p) for t, p in (clip, straight)]
    (R_before, before), (R_after, after) = (pose.posed() for pose in poses)
    np.testing.assert_allclose(R_after[:, 7], R_before[:, 7], atol=1e-9)
    np.testing.assert_allclose(after[:, ANKLES, 2].min(1), before[:, ANKLES, 2].min(1), atol=1e-9)
    along = [anatomy.unit(x[:, 7] - x[:, 1]) for x in (before, after)]
    assert np.degrees(np.arccos((along[0] * along[1]).sum(-1).clip(-1, 1))).max() < 3
