"""A looped motion ends as it begins, and is itself in between."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from imocap_core.motion.motion_cleaning import RootedMotion, blend_offsets, looped

T, FPS = 120, 30.0


def made() -> RootedMotion:
    rng = np.random.default_rng(5)
    vectors = 4 * gaussian_filter1d(rng.normal(size=(T, 6, 3)), 8.0, axis=0)
    R = Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix().reshape(T, 6, 3, 3)
    turning = np.linspace(0.3, 1.5, T)[:, None] * [0.0, 1.0, 0.0]
    R[:, 0] = Rotation.from_rotvec(turning).as_matrix() @ R[:, 0]
    return RootedMotion(R, np.cumsum(0.02 * rng.normal(size=(T, 3)), axis=0) + [1.0, 0.9, 3.0])


def apart(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    between = np.swapaxes(a, -1, -2) @ b
    return Rotation.from_matrix(between.reshape(-1, 3, 3)).magnitude()


@pytest.mark.parametrize("in_place", [False, True])
def test_the_last_pose_is_the_first_but_for_place_and_heading(in_place: bool) -> None:
    before = made()
    after = looped(before, FPS, in_place)
    assert apart(before.R_local[0, 1:], before.R_local[-1, 1:]).max() > 0.2
    assert apart(after.R_local[0, 1:], after.R_local[-1, 1:]).max() < 1e-7
    advance = after.R_local[-1, 0] @ after.R_local[0, 0].T
    np.testing.assert_allclose(advance @ [0, 1, 0], [0, 1, 0], atol=1e-9)
    moved = after.pelvis[-1] - after.pelvis[0]
    assert moved[1] == pytest.approx(0, abs=1e-12)
    if in_place:
        np.testing.assert_allclose(moved, 0, atol=1e-12)
        np.testing.assert_allclose(advance, np.eye(3), atol=1e-9)
    else:
        expected = (before.pelvis[-1] - before.pelvis[0])[[0, 2]]
        np.testing.assert_allclose(moved[[0, 2]], expected, atol=1e-12)


def test_what_is_not_near_the_ends_stays_as_it_is() -> None:
    before = made()
    after = looped(before, FPS, in_place=False)
    middle = slice(15, T - 15)
    np.testing.assert_allclose(after.R_local[middle], before.R_local[middle], atol=1e-12)
    np.testing.assert_allclose(after.pelvis[middle], before.pelvis[middle], atol=1e-12)


def test_speeds_agree_where_it_is_joined() -> None:
    values = np.stack([np.linspace(0, 1, T) ** 2, np.sin(np.linspace(0, 5, T))], axis=1)
    closed = values + blend_offsets(values, 30)
    np.testing.assert_allclose(closed[-1], closed[0], atol=1e-12)
    jump = np.abs((closed[1] - closed[0]) - (closed[-1] - closed[-2]))
    was = np.abs((values[1] - values[0]) - (values[-1] - values[-2]))
    assert np.all(jump < 0.2 * was)


def test_a_short_clip_is_joined_too() -> None:
    short = RootedMotion(made().R_local[:4], made().pelvis[:4])
    after = looped(short, FPS, in_place=True)
    assert apart(after.R_local[0], after.R_local[-1]).max() < 1e-7
