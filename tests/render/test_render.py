"""The rasteriser against a slow twin, and the laws of pictures and of views from all sides."""

import numpy as np
import pytest
import torch

from imocap_core import render, rotations
from imocap_core.body import load_free_body
from imocap_core.render import Light, draw_mesh, rasterize, vertex_normals

K = np.array([[80.0, 0.0, 31.5], [0.0, 80.0, 23.5], [0.0, 0.0, 1.0]])
SIZE = (64, 48)
FLAT = Light(ambient=1.0, diffuse=0.0, sky=0.0)


def sphere(radius: float, rings: int = 16) -> tuple[np.ndarray, np.ndarray]:
    """A closed ball around the origin, faces counter-clockwise from outside."""
    polar, turn = np.meshgrid(
        np.linspace(1e-3, np.pi - 1e-3, rings), np.linspace(0, 2 * np.pi, 2 * rings + 1)[:-1]
    )
    vertices = radius * np.stack(
        [np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=-1
    )
    index = np.arange(vertices.shape[0] * rings).reshape(-1, rings)
    a, b = index[:, :-1].ravel(), np.roll(index, -1, axis=0)[:, :-1].ravel()
    faces = np.concatenate([np.stack([a, a + 1, b], 1), np.stack([b, a + 1, b + 1], 1)])
    return vertices.reshape(-1, 3), faces


def test_rasterize_agrees_with_its_slow_twin():
    rng = np.random.default_rng(0)
    xy, depth = rng.uniform(-4, 24, (30, 2)), rng.uniform(1, 3, 30)
    faces = rng.permutation(30).reshape(10, 3)
    surface = rasterize(xy, depth, faces, (20, 16))
    # One pixel and one triangle at a time; the nearest face index or -1, (height, width).
    size = (20, 16)
    nearest = np.full(size[::-1], np.inf)
    winner = np.full(size[::-1], -1)
    for index, face in enumerate(faces):
        (ax, ay), (bx, by), (cx, cy) = xy[face]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area >= 0:
            continue
        for y in range(size[1]):
            for x in range(size[0]):
                w1 = ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / area
                w2 = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / area
                if min(w1, w2, 1 - w1 - w2) < 0:
                    continue
                z = 1 / np.dot([1 - w1 - w2, w1, w2], 1 / depth[face])
                if z < nearest[y, x]:
                    nearest[y, x], winner[y, x] = z, index
    np.testing.assert_array_equal(surface.face.reshape(16, 20), winner)
    np.testing.assert_allclose(surface.closeness.reshape(16, 20), 1.0 / nearest)


def test_normals_of_a_sphere_are_its_radii():
    vertices, faces = sphere(0.7)
    normals = vertex_normals(vertices, faces)
    assert (np.einsum("vi,vi->v", normals, vertices / 0.7) > 0.99).all()


GREY = np.full(3, 200.0)


def draw(image, vertices, faces, camera=K, **how):
    return draw_mesh(image, vertices, faces, GREY, camera, np.eye(3), np.zeros(3), **how)


def test_a_ball_covers_the_disc_that_geometry_demands():
    vertices, faces = sphere(0.5, rings=48)
    drawn = draw(np.zeros((48, 64, 3), np.uint8), vertices + [0, 0, 3.0], faces, light=FLAT)
    area_px = np.pi * (80 * 0.5 / np.sqrt(3.0**2 - 0.5**2)) ** 2
    assert drawn[..., 0].sum() / 200.0 == pytest.approx(area_px, rel=0.01)
    rows, columns = np.nonzero(drawn[..., 0])
    assert np.allclose([columns.mean(), rows.mean()], [31.5, 23.5], atol=0.15)


def test_the_nearer_ball_hides_the_farther_one():
    vertices, faces = sphere(0.3)
    lit = Light(towards_lamp=(0.0, 0.0, -1.0), up=(0.0, -1.0, 0.0), ambient=0, diffuse=1, sky=0)
    near = draw(_paper(), vertices + [0, 0, 2.0], faces, light=lit)
    for first, second in ((2.0, 3.0), (3.0, 2.0)):
        balls = np.concatenate([vertices + [0, 0, first], vertices + [0, 0, second]])
        drawn = draw(_paper(), balls, np.concatenate([faces, faces + len(vertices)]), light=lit)
        np.testing.assert_array_equal(drawn, near)


def test_alpha_blends_and_the_picture_given_is_left_alone():
    vertices, faces = sphere(0.5)
    image = _paper()
    half = draw(image, vertices + [0, 0, 3.0], faces, alpha=0.5, light=FLAT)
    assert half[24, 32, 0] == pytest.approx(150, abs=1)
    assert (half[0, 0] == 100).all()
    assert (image == 100).all()
    assert (draw(image, vertices + [0, 0, 3.0], faces, alpha=0.0) == image).all()


@pytest.mark.parametrize("t", [(0, 0, -3.0), (40.0, 0, 3.0)], ids=["behind", "beside"])
def test_a_mesh_out_of_sight_changes_nothing(t):
    vertices, faces = sphere(0.5)
    assert (draw(_paper(), vertices + t, faces) == 100).all()


def _paper() -> np.ndarray:
    return np.full((48, 64, 3), 100, np.uint8)


VIEW_SIZE = (80, 100)


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
    px_per_m = render.common_scale(body[None], heading[None], VIEW_SIZE)
    picture = render.draw_view(body, faces, colors, heading, view, VIEW_SIZE, px_per_m)
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


def test_a_homography_of_the_picture_moves_what_is_drawn():
    vertices, faces = sphere(0.4)
    shift = np.array([[1.0, 0, 7], [0, 1, -5], [0, 0, 1]])
    still = draw(_paper(), vertices + [0, 0, 4.0], faces)
    moved = draw(_paper(), vertices + [0, 0, 4.0], faces, shift @ K)
    np.testing.assert_array_equal(moved, np.roll(still, (-5, 7), axis=(0, 1)))


def test_alpha_is_a_share():
    with pytest.raises(ValueError, match=r"alpha: expected a share from 0 to 1, got 1\.5"):
        draw(_paper(), *sphere(0.5), alpha=1.5)


def test_from_inside_nothing_is_seen():
    assert (draw(_paper(), *sphere(0.5)) == 100).all()
