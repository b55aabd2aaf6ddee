"""What the network reads does not depend on where in the picture the person is."""

import numpy as np
import pytest
import torch

from imocap_core.lifter.lifter_network import COMMON, FEATURES, person_centred_features

K = len(COMMON)


def person(seed: int = 0) -> torch.Tensor:
    """Points (1, L, K, 3) about a person 4 m in front of the camera."""
    rng = np.random.default_rng(seed)
    return torch.as_tensor(rng.normal(0, 0.4, (1, 5, K, 3)) + (0.2, -0.1, 4.0))


def rays_of(points: torch.Tensor) -> torch.Tensor:
    return points[..., :2] / points[..., 2:]


@pytest.mark.parametrize("angle", [-0.5, 0.2, 0.7])
def test_panning_the_camera_changes_nothing_but_its_own_turn(angle: float) -> None:
    """The features stay to rounding of the middle: exactly where the median ray is the same."""
    pan = torch.tensor(
        [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    )
    points = person()
    trust = torch.ones(points.shape[:3], dtype=points.dtype)
    still, panned = (person_centred_features(rays_of(x), trust) for x in (points, points @ pan.T))
    turned_back = panned.R_turned_from_cam @ pan
    away = torch.acos(
        ((turned_back @ still.R_turned_from_cam.mT).diagonal(dim1=1, dim2=2).sum(-1) - 1) / 2
    )
    assert float(away) < 0.05  # a median per axis is not quite the same point after a turn
    assert float((panned.features - still.features).abs().mean()) < 0.05


def test_the_camera_turns_to_the_person() -> None:
    points = person()
    trust = torch.ones(points.shape[:3], dtype=points.dtype)
    centred = person_centred_features(rays_of(points), trust)
    middle = torch.cat([rays_of(points).flatten(1, 2).median(1).values, torch.ones(1, 1)], -1)
    turned = centred.R_turned_from_cam[0] @ middle[0].double()
    np.testing.assert_allclose(turned[:2], 0, atol=1e-9)
    R = centred.R_turned_from_cam[0]
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-9)
    assert float(torch.linalg.det(R)) == pytest.approx(1.0)


def test_a_nearer_person_differs_in_one_feature_alone() -> None:
    """Rays that are all larger by a factor say nearer, and nothing else of the pose."""
    rng = np.random.default_rng(1)
    rays = torch.as_tensor(rng.normal(0, 0.02, (1, 5, K, 2)))
    rays = rays - rays.flatten(1, 2).median(1).values
    trust = torch.ones(rays.shape[:3], dtype=rays.dtype)
    far, near = (person_centred_features(s * rays, trust).features for s in (1.0, 2.0))
    change = (near - far).abs().amax((0, 1))
    nearness = FEATURES - 2
    assert float(change[nearness]) == pytest.approx(np.log(2), abs=1e-6)
    assert float(torch.cat([change[:nearness], change[nearness + 1 :]]).max()) < 1e-6


def test_what_is_not_seen_does_not_matter() -> None:
    points = person()
    trust = torch.ones(points.shape[:3], dtype=points.dtype)
    trust[:, 2, 4:9] = 0.0
    trust[:, 4] = 0.0
    rays = rays_of(points)
    junk = torch.where(trust[..., None] > 0, rays, 77.0)
    a, b = person_centred_features(rays, trust), person_centred_features(junk, trust)
    np.testing.assert_array_equal(a.features, b.features)
    assert (a.features[:, 4] == 0).all()
