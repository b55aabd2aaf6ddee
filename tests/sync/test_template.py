"""The template: every direction by the videos to which it is lateral."""

import numpy as np
from scipy.spatial.transform import Rotation

from imocap_core.sync.maps import BandedMap
from imocap_core.sync.procrustes import centred
from imocap_core.sync.warp.template import (
    ISOTROPIC,
    VIEW_PRECISION,
    fused,
    isotropic_poses,
    poses_of_reference,
    poses_of_video,
)

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
