"""The template of every direction, and which keypoints a motion explains."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.sync.maps import FRAMES, BandedMap, search_bands, whole_band
from imocap_core.sync.procrustes import centred, rotations_onto
from imocap_core.sync.screening.explanation import explained_change, registered
from imocap_core.sync.screening.registration import (
    Keypoints2D,
    best_warp,
    camera_directions,
    centred_plane,
    reflected_keypoints,
    registration_residual,
    unbiased_directions,
)
from imocap_core.sync.warp import template
from imocap_core.sync.warp.leave_one_out_template import (
    axis_precisions,
    squared_view_distances,
    whitening,
)
from imocap_core.sync.warp.monotone import StepPrior, banded_posterior
from imocap_core.sync.warp.rate import banded_rate_posterior, rate_prior
from imocap_core.sync.warp.template import (
    ISOTROPIC,
    VIEW_PRECISION,
    NearbySquares,
    fused,
    isotropic_poses,
    poses_of_reference,
    poses_of_video,
)
from tests.sync import made_motions
from tests.sync.made_motions import view_of, wandering
from tests.sync.test_dtw import monotone_posterior

T, J = 12, 7


def _poses(rng: np.random.Generator) -> np.ndarray:
    poses: np.ndarray = rng.normal(0.0, 0.4, (T, J, 3))
    return centred(poses, np.ones((T, J)))


def test_the_mean_is_the_direct_weighted_one() -> None:
    rng = np.random.default_rng(0)
    poses, soft = _poses(rng), rng.dirichlet(np.full(3 * T - 2, 0.2), T)
    weights = rng.uniform(0.2, 1.0, (T, J))
    base = poses_of_reference(_poses(rng), np.ones((T, J)), 3, VIEW_PRECISION)
    part = poses_of_video(poses, weights, BandedMap.of(soft), base, VIEW_PRECISION, 0.0)
    both = fused([base, part])

    shared = weights * (soft @ base.weights)
    targets = np.einsum("ns,sja->nja", soft, base.poses)
    a, b = centred(poses, shared), centred(targets, shared)
    for s in (0, 4, 3 * T - 3):
        for j in (0, J - 1):
            precision, pull, total = np.zeros((3, 3)), np.zeros(3), 0.0
            for t in range(T):
                R = Rotation.align_vectors(b[t], a[t], weights=shared[t])[0].as_matrix()
                of_frame = soft[t, s] * weights[t, j] * R @ np.diag(VIEW_PRECISION) @ R.T
                precision += of_frame
                pull += of_frame @ R @ a[t, j]
                total += soft[t, s] * weights[t, j]
            np.testing.assert_allclose(
                part.poses[s, j], np.linalg.solve(precision, pull), atol=1e-6
            )
            share = precision / max(total, 1.0)
            np.testing.assert_allclose(part.precision[s, j], share, atol=1e-12)
            mean = np.linalg.solve(
                share + base.precision[s, j],
                share @ part.poses[s, j] + base.precision[s, j] @ base.poses[s, j],
            )
            np.testing.assert_allclose(both.poses[s, j], mean, atol=1e-6)


def test_poses_alike_in_all_directions_have_the_plain_mean() -> None:
    rng = np.random.default_rng(1)
    parts = [isotropic_poses(_poses(rng), rng.uniform(0.1, 1.0, (T, J))) for _ in range(3)]
    weights = np.stack([p.weights for p in parts])[..., None]
    plain = (weights * np.stack([p.poses for p in parts])).sum(0) / weights.sum(0)
    np.testing.assert_allclose(fused(parts).poses, plain, atol=1e-8)


def test_depth_of_one_camera_is_resolved_by_another() -> None:
    rng = np.random.default_rng(2)
    true = _poses(rng)
    aside = Rotation.from_euler("y", 90, degrees=True).as_matrix()
    guessed = np.array([0.005, 0.005, 0.08])  # metres, along the camera's axes
    first = true + rng.normal(size=true.shape) * guessed
    second = true @ aside.T + rng.normal(size=true.shape) * guessed
    there, maps = np.ones((T, J)), BandedMap.of(np.eye(T))
    errors = {}
    for name, axes in (("by axes", VIEW_PRECISION), ("plain", ISOTROPIC)):
        base = poses_of_reference(first, there, 1, axes)
        both = fused([base, poses_of_video(second, there, maps, base, axes, 3.0)])
        errors[name] = float(np.sqrt(((both.poses - true) ** 2).mean()))
    assert errors["by axes"] < 0.7 * errors["plain"]


def test_joints_that_are_visible_in_no_video_have_no_weight() -> None:
    rng = np.random.default_rng(3)
    weights = np.ones((T, J))
    weights[:, 2] = 0.0
    poses = _poses(rng)
    poses[:, 2] = np.nan
    base = poses_of_reference(poses, weights, 1, VIEW_PRECISION)
    part = poses_of_video(poses, weights, BandedMap.of(np.eye(T)), base, VIEW_PRECISION, 0.0)
    both = fused([base, part])
    assert np.isfinite(both.poses).all()
    assert (both.weights[:, 2] == 0).all()
    assert (both.weights[:, [0, 1, 3]] > 0).all()


N, S = 3 * FRAMES + 5, 260
STEPS = StepPrior(12, 60, 0.05)


def costs() -> np.ndarray:
    """Of a noisy warp at a changing rate."""
    rng = np.random.default_rng(0)
    warp = np.linspace(0, 1, N) ** 1.3 * (S - 1)
    away = np.minimum(0.02 * (np.arange(S) - warp[:, None]) ** 2, 6.0)
    return np.asarray(away + 0.3 * rng.random((N, S)))


@pytest.mark.parametrize("at_once", [1 << 20, 3 * S])
def test_distances_near_a_map_are_those_of_all(at_once, monkeypatch):
    monkeypatch.setattr(template, "ENTRIES_AT_ONCE", at_once)
    squares = costs()
    squares[7] = np.nan
    bands = search_bands([BandedMap.of(np.eye(N, S))], 9)
    nearby = NearbySquares.computed((N, S), bands, lambda t, s: squares[t, s])
    for rows, columns, values in nearby.nearby:
        np.testing.assert_array_equal(values, squares[rows, columns])
    assert len(nearby.nearby.bands) == 4
    np.testing.assert_array_equal(nearby.least, squares.min(axis=1))


def test_of_very_many_positions_every_nth_is_compared_and_all_near_ones(monkeypatch):
    monkeypatch.setattr(template, "ALL_COMPARED", N * S // 4)
    squares, compared = costs(), []

    def block(frames: slice, positions: slice) -> np.ndarray:
        part = squares[frames, positions]
        compared.append(part.size)
        return part

    bands = search_bands([BandedMap.of(np.eye(N, S))], 9)
    nearby = NearbySquares.computed((N, S), bands, block)
    assert sum(compared) < 0.6 * N * S
    assert (nearby.least >= squares.min(axis=1)).all()
    for rows, columns, values in nearby.nearby:
        np.testing.assert_array_equal(values, squares[rows, columns])
        assert (nearby.least[rows] <= values.min(axis=1)).all()


def test_warps_within_a_band_are_those_of_all_where_the_others_are_unlikely() -> None:
    cost, unmatched = 4.0 * costs(), np.full(N, 9.0)
    prior = rate_prior(usual=S / N, spread=0.35, persistence_s=1.0, max_rate=8.0, fps=30.0)
    dense, matched = monotone_posterior(cost, unmatched=unmatched, steps=STEPS)
    whole, smooth_matched = banded_rate_posterior(
        whole_band(cost), prior, unmatched=unmatched, skipped=0.1
    )
    smooth = whole.dense()
    both = [BandedMap.of(dense, 1e-12), BandedMap.of(smooth, 1e-12)]
    bands = search_bands(both, 20)
    near = BandedMap.computed((N, S), bands, lambda t, s: cost[t, s])
    assert sum(x.size for x in near.values) < 0.6 * N * S
    banded, banded_matched = banded_posterior(near, unmatched=unmatched, steps=STEPS)
    np.testing.assert_allclose(banded.dense(), dense, atol=1e-9)
    np.testing.assert_allclose(banded_matched, matched, atol=1e-9)
    rates, rates_matched = banded_rate_posterior(near, prior, unmatched=unmatched, skipped=0.1)
    np.testing.assert_allclose(rates.dense(), smooth, atol=1e-9)
    np.testing.assert_allclose(rates_matched, smooth_matched, atol=1e-9)


def test_a_trimmed_map_is_narrow_whatever_bands_it_had() -> None:
    soft_map = monotone_posterior(4.0 * costs(), unmatched=np.inf, steps=STEPS)[0]
    trimmed = whole_band(soft_map).trimmed(1e-6)
    assert [r.stop - r.start for r, _ in trimmed.bands] == [FRAMES] * 3 + [5]
    np.testing.assert_allclose(trimmed.dense(), soft_map, atol=1e-6)
    assert sum(x.size for x in trimmed.values) < 0.5 * N * S


def all_squares(*scene: Any) -> np.ndarray:
    """Of all frames and positions."""
    return squared_view_distances(*scene)(slice(None), slice(None))


def test_is_the_weighted_distance_of_every_pair() -> None:
    rng = np.random.default_rng(0)
    others = rng.normal(size=(9, 10, 3))
    R_other_from_pose = Rotation.random(random_state=1).as_matrix()
    poses = others[:7] @ R_other_from_pose + rng.normal(size=(7, 10, 3)) * [0.1, 0.1, 0.25]
    w, u, maps = np.ones((7, 10)), np.ones((9, 10)), BandedMap.of(np.eye(7, 9))
    squares = all_squares(poses, w, others, u, maps, 5.0)

    x, y = centred(poses, w), centred(others, u)
    R = rotations_onto(x, y[:7], w, 5.0)
    precision = axis_precisions(x - np.einsum("nab,nja->njb", R, y[:7]), w)
    naive = [
        [float((((x[t] - y[s] @ R[t]) ** 2) * precision).sum(-1).mean()) for s in range(9)]
        for t in range(7)
    ]
    np.testing.assert_allclose(squares, naive, atol=1e-12)
    assert precision[2] < 0.5 * precision[0]


def test_rotations_are_recovered_and_smooth() -> None:
    rng = np.random.default_rng(2)
    truth = Rotation.random(random_state=3).as_matrix()
    poses, ones = rng.normal(size=(40, 12, 3)), np.ones((40, 12))
    targets = poses @ truth.T + 0.3 * rng.normal(size=poses.shape)

    def spread(window: float) -> float:
        R = rotations_onto(poses, targets, ones, window)
        return float(np.linalg.norm(R - truth, axis=(1, 2)).mean())

    assert spread(8.0) < 0.5 * spread(0.0)


def test_missing_joints_do_not_count() -> None:
    rng = np.random.default_rng(4)
    poses, others = rng.normal(size=(6, 10, 3)), rng.normal(size=(8, 10, 3))
    w, u, maps = np.ones((6, 10)), np.ones((8, 10)), BandedMap.of(rng.random((6, 8)))
    w[:, 4:] = 0.0
    u[:, 4:] = 0.0
    whole = all_squares(poses, w, others, u, maps, 2.0)
    poses[:, 4:], others[:, 4:] = np.nan, 50.0
    np.testing.assert_allclose(all_squares(poses, w, others, u, maps, 2.0), whole)
    u[2] = 0.0
    assert np.isnan(all_squares(poses, w, others, u, maps, 2.0)[:, 2]).all()


def test_equal_axes_have_equal_precision() -> None:
    residuals = np.random.default_rng(5).normal(size=(300, 20, 3))
    np.testing.assert_allclose(axis_precisions(residuals, np.ones((300, 20))), 1.0, atol=0.1)


def errors(rng: np.random.Generator, n: int = 4000) -> np.ndarray:
    """Six joints: three wrong together, three alone, the last three times as much."""
    noise = rng.normal(size=(n, 6, 3))
    noise[:, :3] += 2.0 * rng.normal(size=(n, 1, 3))
    noise[:, 5] *= 3.0
    return noise


def test_features_are_nearly_independent() -> None:
    residuals = errors(np.random.default_rng(0))
    W = whitening(residuals, np.ones(residuals.shape[:2]))
    before = np.corrcoef(residuals[..., 0].T)
    after = np.corrcoef((W @ residuals)[..., 0].T)
    off = ~np.eye(6, dtype=bool)
    assert np.abs(after[off]).max() < 0.35
    assert np.abs(before[off]).max() > 0.7
    spread = (W @ residuals).std(axis=(0, 2))
    assert spread.max() < 1.6 * spread.min()


def test_missing_joints_or_few_frames_leave_joints_as_they_are() -> None:
    residuals = errors(np.random.default_rng(1), 300)
    weights = np.ones(residuals.shape[:2])
    weights[5, 2] = 0.0
    np.testing.assert_array_equal(whitening(residuals, weights), np.eye(6))
    np.testing.assert_array_equal(whitening(residuals[:9], np.ones((9, 6))), np.eye(6))


JOINTS, SHOWN = 12, 60


def motion_of(seed: int) -> np.ndarray:
    return wandering(seed, JOINTS, SHOWN)


def filmed(motion: np.ndarray, azimuth: float, step: int = 1) -> Keypoints2D:
    return made_motions.filmed(view_of(motion[::step], azimuth))


@pytest.mark.parametrize("azimuth", [0.0, 1.0, 2.5, 4.0])
def test_a_motion_explains_its_pictures_from_any_side(azimuth: float) -> None:
    directions = camera_directions(256)
    same = registration_residual(motion_of(1), filmed(motion_of(1), azimuth, 2), directions)
    other = registration_residual(motion_of(2), filmed(motion_of(1), azimuth, 2), directions)
    assert same < 0.25
    assert other > 2 * same


def test_scale_place_and_missing_joints_do_not_matter() -> None:
    directions, film = camera_directions(), filmed(motion_of(1), 0.7)
    before = registration_residual(motion_of(1), film, directions)
    moved = Keypoints2D(3.0 * film.xy_px + 50.0, film.weight)
    assert registration_residual(motion_of(1), moved, directions) == pytest.approx(before)
    hidden = Keypoints2D(film.xy_px.copy(), film.weight.copy())
    hidden.xy_px[:, 3], hidden.weight[:, 3] = np.nan, 0.0
    assert registration_residual(motion_of(1), hidden, directions) < 1.5 * before


def test_directions_are_level_cameras() -> None:
    axes = camera_directions()
    np.testing.assert_allclose(
        np.einsum("dij,dkj->dik", axes, axes), [np.eye(2)] * len(axes), atol=1e-9
    )
    np.testing.assert_allclose(axes[:, 0, 1], 0.0, atol=1e-12)  # the horizon is level
    assert (axes[:, 1, 1] > 0).all()  # down is down


def test_registration_finds_the_camera_the_warp_and_the_change() -> None:
    film = filmed(motion_of(1), 0.9, 2)
    directions = unbiased_directions()
    view = registered(motion_of(1), film, directions)
    assert view.residual <= registration_residual(motion_of(1), film, directions)
    assert view.residual < 0.15
    assert view.explained_change > 0.9
    np.testing.assert_allclose(view.frames, np.arange(0, SHOWN, 2), atol=2)
    truth = np.array([[np.cos(0.9), 0.0, np.sin(0.9)], [0.0, 1.0, 0.0]])
    assert (np.sum(view.axes * truth, axis=1) > np.cos(np.deg2rad(10.0))).all()


@pytest.mark.parametrize("speed", [0.4, 0.5, 1.0, 2.0, 2.5])
def test_another_speed_costs_next_to_nothing_and_standing_still_does(speed: float) -> None:
    positions = np.arange(0, SHOWN - 1, speed)
    distance = np.abs(positions[:, None] - np.arange(SHOWN)) / 10
    cost, frames = best_warp(distance)
    assert (cost - distance[np.arange(len(frames)), frames].sum()) / len(frames) <= 0.021
    np.testing.assert_allclose(frames, positions, atol=1.0)
    still = best_warp(np.repeat(distance[:1], 40, axis=0))[0]
    assert still / 40 > 0.04


def test_explained_change_is_that_of_the_motion_whatever_is_wrong_throughout() -> None:
    film, rng = filmed(motion_of(1), 0.0), np.random.default_rng(1)
    plane, axes = centred_plane(film), np.eye(3)[:2]
    lasting = rng.normal(0, 0.5, (JOINTS, 3))

    def explained(motion: np.ndarray) -> float:
        return explained_change(motion @ axes.T, plane, film.weight)

    assert explained(motion_of(1)) > 0.98
    assert explained(motion_of(1) + lasting) > 0.8
    assert abs(explained(np.repeat(motion_of(1).mean(axis=0)[None], SHOWN, axis=0))) < 0.05
    assert explained(motion_of(2)) < 0.2
    garbled = motion_of(1)
    garbled[20:30] += rng.normal(0, 3.0, (10, JOINTS, 3))
    assert explained(garbled) > 0.7


def test_reflecting_keypoints_twice_changes_nothing() -> None:
    twins = [1, 0, 3, 2, 5, 4, 7, 6, 8, 9, 11, 10]
    film = filmed(motion_of(1), 1.2)
    twice = reflected_keypoints(reflected_keypoints(film, twins), twins)
    np.testing.assert_allclose(twice.xy_px, film.xy_px)
    np.testing.assert_array_equal(twice.weight, film.weight)


def test_nothing_visible_explains_nothing() -> None:
    film = filmed(motion_of(1), 0.0)
    unseen = Keypoints2D(film.xy_px, np.zeros_like(film.weight))
    assert registration_residual(motion_of(1), unseen, camera_directions()) == 1.0
