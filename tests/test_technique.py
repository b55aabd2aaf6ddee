"""Technique on made motions: known spreads, and what must not matter."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.technique import (
    AlignedPerformances,
    at_moments,
    consistency,
    difference,
    facing_alike,
    mean_motion,
    spread,
    to_the_front,
    turned_by,
)

M, N, J = 5, 40, 4
PHASE = np.linspace(0, 2, N)


def smooth(rng: np.random.Generator, size: float, count: int = 3) -> np.ndarray:
    """(N, J, count) smooth random courses."""
    frequency = rng.uniform(0.5, 3, (J, count))
    start = rng.uniform(0, 6, (J, count))
    return size * np.sin(frequency * PHASE[:, None, None] + start)


def made(
    seed: int = 0, noise_m: float = 0.0, turns: np.ndarray | None = None
) -> AlignedPerformances:
    """M performances: one common motion, deviations (M, N, J, 3) rad, noise of places in metres."""
    rng = np.random.default_rng(seed)
    common = Rotation.from_rotvec(smooth(rng, 0.6).reshape(-1, 3)).as_matrix().reshape(N, J, 3, 3)
    deviations = np.zeros((M, N, J, 3)) if turns is None else turns
    R = common @ Rotation.from_rotvec(deviations.reshape(-1, 3)).as_matrix().reshape(M, N, J, 3, 3)
    places = smooth(rng, 0.4)
    joints = places + noise_m * rng.normal(size=(M, N, J, 3))
    joints[:, :, 0] = 0.0  # the pelvis, from itself
    names = ("pelvis", "knee", "elbow", "head")
    ids = tuple(f"v{m}" for m in range(M))
    return AlignedPerformances(ids, names, PHASE, R, joints, np.ones((M, N), dtype=bool))


def test_equal_performances_agree_wholly() -> None:
    performances = made()
    mean = mean_motion(performances)
    np.testing.assert_allclose(mean.R_local, performances.R_local[0], atol=1e-9)
    np.testing.assert_allclose(mean.joints, performances.joints[0], atol=1e-12)
    assert np.abs(spread(mean.turns, performances.inside)).max() < 1e-6
    assert consistency(performances.joints, performances.inside) == pytest.approx(1.0)


def test_where_a_performance_faces_does_not_matter() -> None:
    performances = made(noise_m=0.02)
    headings = np.array([0.0, 2.0, -1.0, 3.1, 0.4])
    aligned, turned = facing_alike(performances), facing_alike(turned_by(performances, headings))
    for a, b in ((aligned, turned),):
        both = np.einsum("mnja,mnja->mnj", a.joints - a.joints[:1], b.joints - b.joints[:1])
        assert (both >= -1e-9).all()
        before = spread(mean_motion(a).shifts, a.inside)
        after = spread(mean_motion(b).shifts, b.inside)
        np.testing.assert_allclose(after, before, atol=1e-6)
        np.testing.assert_allclose(
            spread(mean_motion(b).turns, b.inside),
            spread(mean_motion(a).turns, a.inside),
            atol=1e-6,
        )


def test_the_front_is_where_the_left_hip_is_on_the_right() -> None:
    upright = made()
    still = np.broadcast_to(np.eye(3), upright.R_local.shape).copy()
    performances = turned_by(replace(upright, R_local=still), np.full(M, 1.1))
    front = to_the_front(performances)
    np.testing.assert_allclose(front.R_local[:, :, 0], still[:, :, 0], atol=1e-12)
    np.testing.assert_allclose(front.joints, upright.joints, atol=1e-12)


def test_how_a_performance_turns_in_its_course_stays() -> None:
    """One heading for all of it: a turn that only some make is a deviation."""
    turns = np.zeros((M, N, J, 3))
    turns[0, :, 0, 1] = np.linspace(0, 1.5, N)
    performances = facing_alike(made(turns=turns))
    assert np.rad2deg(spread(mean_motion(performances).turns, performances.inside)[-1, 0]) > 10


def test_the_spread_is_the_standard_deviation() -> None:
    rng = np.random.default_rng(1)
    many = rng.normal(scale=[0.01, 0.02, 0.02], size=(400, N, J, 3))
    estimated = spread(many - many.mean(0), np.ones((400, N), dtype=bool))
    np.testing.assert_allclose(np.sqrt((estimated**2).mean(0)), 0.03, rtol=0.03)


def test_consistency_is_the_share_that_the_moment_explains() -> None:
    noise = 0.1
    performances = made(noise_m=noise)
    true = made(noise_m=0.0).joints[0]
    motion = ((true - true.mean(0)) ** 2).sum() / N
    expected = motion / (motion + 3 * (J - 1) * noise**2)  # the pelvis has neither
    got = consistency(performances.joints, performances.inside)
    assert got == pytest.approx(expected, abs=0.03)


def test_unrelated_motions_have_no_consistency_and_units_do_not_matter() -> None:
    rng = np.random.default_rng(4)
    places = rng.normal(size=(6, 500, J, 3))
    assert consistency(places, np.ones((6, 500), dtype=bool)) < 0.02
    performances = made(noise_m=0.05)
    metres, millimetres = (
        consistency(k * performances.joints, performances.inside) for k in (1, 1000)
    )
    assert metres == pytest.approx(millimetres)


def test_moments_that_a_performance_does_not_show_count_for_nothing() -> None:
    performances = made(noise_m=0.03)
    inside = performances.inside.copy()
    inside[0, :15], inside[1:, 30:] = False, False
    spoilt = performances.joints.copy()
    spoilt[~inside] += 7.0
    clean, dirty = (
        replace(performances, inside=inside),
        replace(performances, inside=inside, joints=spoilt),
    )
    assert consistency(clean.joints, inside) == pytest.approx(consistency(spoilt, inside))
    ours = spread(mean_motion(dirty).shifts, inside)
    np.testing.assert_allclose(ours, spread(mean_motion(clean).shifts, inside))
    assert np.isnan(ours[30:]).all()  # one performance alone
    assert np.isfinite(ours[:30]).all()
    assert (dirty.shown == [4] * 15 + [5] * 15 + [1] * 10).all()
    assert len(at_moments(dirty, dirty.shown >= 2).phase_s) == 30


def test_two_performers_differ_by_what_was_done() -> None:
    mean = mean_motion(made())
    bent = mean.R_local.copy()
    bent[:, 1] = bent[:, 1] @ Rotation.from_rotvec([0.2, 0, 0]).as_matrix()
    moved = mean.joints.copy()
    moved[:, 2, 0] += 0.05
    given, unknown = np.full((N, J), 0.01), np.full((N, J), np.nan)
    got = difference(mean.R_local, bent, mean.joints, moved, given, unknown)
    np.testing.assert_allclose(got.angle_deg[:, 1], np.rad2deg(0.2), atol=1e-6)
    np.testing.assert_allclose(got.angle_deg[:, 2], 0, atol=1e-6)
    np.testing.assert_allclose(got.distance_mm[:, 2], 50)
    np.testing.assert_allclose(got.ratio[:, 2], 5)
    none = difference(mean.R_local, bent, mean.joints, moved, unknown, unknown)
    assert np.isnan(none.ratio).all()


def test_one_performance_alone_has_no_consistency() -> None:
    performances = made()
    with pytest.raises(ValueError, match="a moment that two performances show, got none"):
        consistency(performances.joints[:1], performances.inside[:1])
