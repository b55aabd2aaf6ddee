"""A view from a camera that moves, and the unit of its path."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from imocap_core.camera.projection import project_camera
from imocap_core.motion.gauss_newton import linearise
from imocap_core.motion.monocular.fit import estimate_path_unit, guessed_unit, stacked, with_unit
from imocap_core.motion.monocular.starts import Start
from imocap_core.motion.multiview.common_motion import offset_precision
from imocap_core.motion.multiview.scene import common_keypoints
from imocap_core.motion.multiview.timeline import make_timeline
from imocap_core.motion.observations import (
    Observation,
    centres,
    every,
    from_one_place,
    per_video_view,
    place_variance,
)
from imocap_core.motion.prior import load_pose_prior
from imocap_core.motion.state import Body
from imocap_core.motion.terms import Reprojection
from imocap_core.motion.terms.view import project
from imocap_core.params import FitParams
from tests.motion.made import K, scene

FRAMES, UNIT_M = 40, 2.5


def walked(observation: Observation, xyz: np.ndarray, path_m: np.ndarray) -> Observation:
    """The same performance, filmed from a camera along a path."""
    xy = project_camera(xyz - path_m[:, None], K)
    return replace(observation, xy_px=xy, centre_m=path_m)


@pytest.fixture(scope="module")
def made():
    return scene(FRAMES, [0.0], np.random.default_rng(1), noise_px=0.0, path_m=0.0)


@pytest.fixture(scope="module")
def path():
    share = np.linspace(0, 1, FRAMES)[:, None]
    return share * np.array([1.2, 0.1, 0.3])


def test_a_camera_at_one_other_place_is_another_translation(made):
    """Cost, gradient and Hessian are those of a camera with that place in its translation."""
    view = per_video_view(made.observations, made.state.trans)
    place = torch.tensor([0.3, -0.1, 0.2], dtype=torch.float64)
    precision = torch.full((1, FRAMES, 6), 50.0, dtype=torch.float64)
    moved = replace(
        view, centre=place.expand(1, FRAMES, 3), camera=None, offset_precision=precision
    )
    shifted = replace(view, t=view.t - place, offset_precision=precision)
    terms = [Reprojection(made.body, (v,), 3.0) for v in (moved, shifted)]
    costs = [term.cost(made.state) for term in terms]
    torch.testing.assert_close(*costs)
    normals = [linearise([term], made.state) for term in terms]
    torch.testing.assert_close(normals[0].gradient, normals[1].gradient)
    torch.testing.assert_close(normals[0].diagonal, normals[1].diagonal)


def test_a_walking_camera_sees_the_motion_where_it_is(made, path):
    xyz = made.body.positions(made.body.keypoints, made.state)
    observation = walked(made.observations[0], xyz[0].numpy(), path)
    view = per_video_view([observation], made.state.trans)
    pixels, _ = project(view, xyz)
    np.testing.assert_allclose(pixels[0].numpy(), observation.xy_px, atol=1e-9)
    assert centres(made.observations, made.state.trans) is None


def test_from_one_place_a_performance_looks_as_filmed_from_there(made, path):
    xyz = made.body.positions(made.body.keypoints, made.state)[0].numpy()
    observation = walked(made.observations[0], xyz, path)
    still, middle = from_one_place(observation, xyz)
    np.testing.assert_allclose(still.xy_px, project_camera(xyz - middle, K), atol=1e-9)
    assert still.centre_m is None
    same, origin = from_one_place(made.observations[0], xyz)
    assert same is made.observations[0]
    assert not origin.any()


def test_an_uncertain_path_loosens_the_place_and_nothing_else(made, path):
    o = replace(made.observations[0], centre_m=path, place_sd_m=np.full(FRAMES, 0.3))
    own = np.arange(FRAMES, dtype=float)
    timeline = make_timeline([own, own], [np.ones(FRAMES)] * 2, FRAMES)
    keypoints = common_keypoints([made.observations[0], o], timeline)
    keypoints = replace(keypoints, offset_sd=np.full((2, 6), 0.1))
    known, loose = (offset_precision(keypoints, v, made.state.trans) for v in (0, 1))
    torch.testing.assert_close(known, torch.full_like(known, 100.0))
    torch.testing.assert_close(loose[..., :3], known[..., :3])
    torch.testing.assert_close(loose[..., 3:], torch.full_like(loose[..., 3:], 10.0))
    assert not keypoints.moves(0)
    assert keypoints.moves(1)
    variance = place_variance([made.observations[0], o], made.state.trans)
    assert variance[0].max() == 0
    assert variance[1].min() == pytest.approx(0.09)


def test_every_other_frame_keeps_its_place(made, path):
    o = replace(made.observations[0], centre_m=path, place_sd_m=path[:, 0])
    thin = every(o, 2)
    np.testing.assert_array_equal(thin.centre_m, path[::2])
    np.testing.assert_array_equal(thin.place_sd_m, path[::2, 0])


@pytest.mark.long
def test_the_unit_of_a_path_is_told_by_feet_that_stand(made, path):
    """Who stands on the spot must not glide along with the camera."""
    body: Body = made.body
    still = replace(made.state, R_local=made.state.R_local[:, :1].expand_as(made.state.R_local))
    xyz = body.positions(body.keypoints, still)[0].numpy()
    filmed = walked(made.observations[0], xyz, path)
    noise = np.random.default_rng(2).normal(0, 1.0, filmed.xy_px.shape)
    unitless = replace(filmed, xy_px=filmed.xy_px + noise, centre_m=path / UNIT_M)
    guess = guessed_unit(unitless)
    assert guess == pytest.approx(UNIT_M, rel=0.6)
    assert with_unit(unitless, UNIT_M).centre_m == pytest.approx(path)
    start = Start(still.R_local[0], still.trans[0], 0.0)
    assert stacked([start], still.valid).valid.all()
    estimate = estimate_path_unit(
        body, load_pose_prior(), unitless, 1.4 * UNIT_M, [start], FitParams(), 4
    )
    assert estimate.unit_m == pytest.approx(UNIT_M, rel=0.12)
    assert 0 < estimate.relative_sd <= 1
