"""The painter against the exact renderer, and the laws of what is painted."""

import numpy as np
import pytest

from imocap_core.body import load_free_body
from imocap_core.render import Light, draw_mesh, paint_mesh
from tests.render.test_render import FLAT, sphere

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
    light = Light(towards_lamp=(-0.35, -0.55, -0.76), up=(0.0, -1.0, 0.0))
    exact = draw_mesh(
        image, vertices, faces, GREY, K_large, np.eye(3), np.zeros(3), alpha=0.8, light=light
    )
    painted = paint_mesh(image, vertices, faces, K_large, GREY, alpha=0.8, light=light)
    covered = (exact != image).any(axis=2)
    assert covered.sum() > 4000
    assert ((painted != image).any(axis=2) != covered).sum() < 0.06 * covered.sum()
    apart = np.abs(painted.astype(float) - exact)[covered]
    assert apart.mean() < 4.0
    assert np.quantile(apart, 0.98) < 40.0


def test_a_ball_covers_the_disc_that_geometry_demands():
    vertices, faces = sphere(0.5, rings=48)
    drawn = paint_mesh(
        np.zeros((48, 64, 3), np.uint8), vertices + [0, 0, 3.0], faces, K, GREY, light=FLAT
    )
    radius_px = 80 * 0.5 / np.sqrt(3.0**2 - 0.5**2) + 0.25  # its edge: half a fine pixel
    assert drawn[..., 0].sum() / 200.0 == pytest.approx(np.pi * radius_px**2, rel=0.02)
    rows, columns = np.nonzero(drawn[..., 0])
    assert np.allclose([columns.mean(), rows.mean()], [31.5, 23.5], atol=0.15)


def test_the_nearer_ball_hides_the_farther_one():
    vertices, faces = sphere(0.3)
    lit = Light(towards_lamp=(0.0, 0.0, -1.0), up=(0.0, -1.0, 0.0), ambient=0, diffuse=1, sky=0)
    near = paint_mesh(_paper(), vertices + [0, 0, 2.0], faces, K, GREY, light=lit)
    for first, second in ((2.0, 3.0), (3.0, 2.0)):
        both = np.concatenate([vertices + [0, 0, first], vertices + [0, 0, second]])
        drawn = paint_mesh(
            _paper(), both, np.concatenate([faces, faces + len(vertices)]), K, GREY, light=lit
        )
        np.testing.assert_array_equal(drawn, near)


def test_a_homography_of_the_picture_moves_what_is_painted():
    vertices, faces = sphere(0.4)
    shift = np.array([[1.0, 0, 7], [0, 1, -5], [0, 0, 1]])
    still = paint_mesh(_paper(), vertices + [0, 0, 4.0], faces, K, GREY)
    moved = paint_mesh(_paper(), vertices + [0, 0, 4.0], faces, shift @ K, GREY)
    np.testing.assert_array_equal(moved, np.roll(still, (-5, 7), axis=(0, 1)))


def test_alpha_blends_and_the_picture_given_is_left_alone():
    vertices, faces = sphere(0.5)
    image = _paper()
    args = (vertices + [0, 0, 3.0], faces, K, GREY)
    half = paint_mesh(image, *args, alpha=0.5, light=FLAT)
    assert half[24, 32, 0] == pytest.approx(150, abs=1)
    assert (half[0, 0] == 100).all()
    assert (image == 100).all()
    assert (paint_mesh(image, *args, alpha=0.0) == image).all()
    with pytest.raises(ValueError, match=r"alpha: expected a share from 0 to 1, got 1\.5"):
        paint_mesh(image, *args, alpha=1.5)


@pytest.mark.parametrize("t", [(0, 0, -3.0), (40.0, 0, 3.0)], ids=["behind", "beside"])
def test_a_mesh_out_of_sight_changes_nothing(t):
    vertices, faces = sphere(0.5)
    assert (paint_mesh(_paper(), vertices + t, faces, K, GREY) == 100).all()


def test_from_inside_nothing_is_seen():
    vertices, faces = sphere(0.5)
    assert (paint_mesh(_paper(), vertices, faces, K, GREY) == 100).all()
