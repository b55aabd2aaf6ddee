"""Laws of the views from front, side and back."""

import numpy as np
import pytest
import torch

from imocap_core import render, rotations
from imocap_core.body import load_free_body
from tests.render.test_render import sphere

SIZE = (80, 100)


def _rotation(*axis_angle: float) -> np.ndarray:
    return rotations.exp(torch.tensor(axis_angle, dtype=torch.float64)).numpy()


@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.5])
def test_a_turned_body_has_the_same_heading_however_it_bends(yaw: float) -> None:
    turned, expected = _rotation(0, yaw, 0), np.array([np.sin(yaw), 0, np.cos(yaw)])
    for bend in (0.0, 0.9, np.pi / 2, -np.pi / 2):  # upright, bent, on the front, on the back
        assert np.allclose(render.heading_of(turned @ _rotation(bend, 0, 0)), expected)
    for lean in (0.8, np.pi / 2):  # to the side
        assert np.allclose(render.heading_of(turned @ _rotation(0, 0, lean)), expected)
    assert np.allclose(render.heading_of(turned @ _rotation(np.pi, 0, 0)), -expected)  # on the head


def test_the_heading_of_who_rolls_on_all_fours_does_not_jump() -> None:
    rolls = [_rotation(0, roll, 0) for roll in np.linspace(0, 1.2, 25)]
    headings = [render.heading_of(_rotation(np.pi / 2, 0, 0) @ roll) for roll in rolls]
    assert (np.linalg.norm(np.diff(headings, axis=0), axis=1) < 0.06).all()


@pytest.mark.parametrize("view", render.VIEWS)
def test_cameras_are_level_and_proper(view: str) -> None:
    R = render.view_rotation(np.array([0.6, 0.0, 0.8]), view)
    assert np.allclose(R @ R.T, np.eye(3))
    assert np.linalg.det(R) == pytest.approx(1)
    assert np.allclose(R @ render.UP, [0, -1, 0])


def test_where_the_body_faces_and_where_its_left_is() -> None:
    heading, left = np.array([0.0, 0, 1]), np.array([1.0, 0, 0])
    assert np.allclose(render.view_rotation(heading, "front") @ heading, [0, 0, -1])
    assert np.allclose(render.view_rotation(heading, "front") @ left, [1, 0, 0])
    assert np.allclose(render.view_rotation(heading, "side") @ heading, [1, 0, 0])
    assert np.allclose(render.view_rotation(heading, "side") @ left, [0, 0, 1])
    assert np.allclose(render.view_rotation(heading, "back") @ heading, [0, 0, 1])
    with pytest.raises(ValueError, match="view: expected one of front, side, back, got 'above'"):
        render.view_rotation(heading, "above")


@pytest.mark.parametrize("view", render.VIEWS)
def test_the_whole_body_is_in_the_middle_over_the_ground(view: str) -> None:
    model, heading = load_free_body(), np.array([0.0, 0, 1])
    body = model.v_template.numpy()
    body = body - body[:, 1].min() * render.UP + [5.0, 0, -3]
    faces = model.faces.numpy()
    colors = np.full((len(faces), 3), 100.0)
    px_per_m = render.common_scale(body[None], heading[None], SIZE)
    picture = render.draw_view(body, faces, colors, heading, view, SIZE, px_per_m)
    assert picture.shape == (100, 80, 3)
    paper = (picture == render.PAPER_RGB).all(axis=2)
    line = (picture == render.GROUND_RGB).all(axis=2)
    rows, columns = np.nonzero(~paper & ~line)
    assert columns.min() + columns.max() == pytest.approx(79, abs=2)
    assert rows.min() > 0
    assert rows.max() - rows.min() == pytest.approx(px_per_m * np.ptp(body[:, 1]), abs=2)
    (ground,) = np.flatnonzero(line.any(axis=1))
    assert ground == pytest.approx(rows.max(), abs=1)


def test_the_bands_of_the_torso_rise_in_order() -> None:
    model = load_free_body()
    faces, height = model.faces.numpy(), model.v_template[:, 1].numpy()
    colors = render.segment_colors(model.weights.numpy(), model.joint_names, faces)
    middles = []
    for name in ("pelvis", "spine1", "spine2", "spine3", "neck"):
        band = (colors == render.SEGMENT_RGB[name]).all(axis=1)
        assert band.sum() > 50
        middles.append(height[faces[band]].mean())
    assert middles == sorted(middles)
    assert (colors == render.SKIN_RGB).all(axis=1).mean() > 0.5


K = np.array([[80.0, 0.0, 31.5], [0.0, 80.0, 23.5], [0.0, 0.0, 1.0]])
GREY = np.full(3, 200.0)


def _paper() -> np.ndarray:
    return np.full((48, 64, 3), 100, np.uint8)


def test_a_body_looks_as_the_exact_renderer_draws_it():
    model = load_free_body()
    vertices = model.v_template.numpy() * [1.0, -1.0, -1.0] + [0, 0.2, 2.6]
    faces = model.faces.numpy()
    K_large = np.array([[300.0, 0, 160], [0, 300.0, 120], [0, 0, 1]])
    image = np.full((240, 320, 3), 90, np.uint8)
    light = render.Light(towards_lamp=(-0.35, -0.55, -0.76), up=(0.0, -1.0, 0.0))
    exact = render.draw_mesh(
        image, vertices, faces, GREY, K_large, np.eye(3), np.zeros(3), alpha=0.8, light=light
    )
    painted = render.paint_mesh(image, vertices, faces, K_large, GREY, alpha=0.8, light=light)
    covered = (exact != image).any(axis=2)
    assert covered.sum() > 4000
    assert ((painted != image).any(axis=2) != covered).sum() < 0.06 * covered.sum()
    apart = np.abs(painted.astype(float) - exact)[covered]
    assert apart.mean() < 4.0
    assert np.quantile(apart, 0.98) < 40.0


def test_a_homography_of_the_picture_moves_what_is_painted():
    vertices, faces = sphere(0.4)
    shift = np.array([[1.0, 0, 7], [0, 1, -5], [0, 0, 1]])
    still = render.paint_mesh(_paper(), vertices + [0, 0, 4.0], faces, K, GREY)
    moved = render.paint_mesh(_paper(), vertices + [0, 0, 4.0], faces, shift @ K, GREY)
    np.testing.assert_array_equal(moved, np.roll(still, (-5, 7), axis=(0, 1)))


def test_alpha_is_a_share():
    with pytest.raises(ValueError, match=r"alpha: expected a share from 0 to 1, got 1\.5"):
        render.paint_mesh(_paper(), *sphere(0.5), K, GREY, alpha=1.5)


def test_from_inside_nothing_is_seen():
    vertices, faces = sphere(0.5)
    assert (render.paint_mesh(_paper(), vertices, faces, K, GREY) == 100).all()
