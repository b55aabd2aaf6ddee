"""The rasteriser against a slow twin, and the laws of pictures."""

import numpy as np
import pytest

from imocap_core.render import Light, draw_mesh, paint_mesh, rasterize, vertex_normals

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


def rasterize_naive(xy, depth, faces, size):
    """One pixel and one triangle at a time; the nearest face index or -1, (height, width)."""
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
    return nearest, winner


def test_rasterize_agrees_with_its_slow_twin():
    rng = np.random.default_rng(0)
    xy, depth = rng.uniform(-4, 24, (30, 2)), rng.uniform(1, 3, 30)
    faces = rng.permutation(30).reshape(10, 3)
    fragments = rasterize(xy, depth, faces, (20, 16))
    nearest, winner = rasterize_naive(xy, depth, faces, (20, 16))
    winning_face = np.full(20 * 16, -1)
    winning_face[fragments.pixel] = fragments.face
    assert (winning_face.reshape(16, 20) == winner).all()
    np.testing.assert_allclose(fragments.depth, nearest.ravel()[fragments.pixel])
    np.testing.assert_allclose(fragments.weight.sum(axis=1), 1.0)


def test_normals_of_a_sphere_are_its_radii():
    vertices, faces = sphere(0.7)
    normals = vertex_normals(vertices, faces)
    assert (np.einsum("vi,vi->v", normals, vertices / 0.7) > 0.99).all()


def exact(image, vertices, faces, **how):
    """The renderer of figures."""
    grey, eye, zero = np.full(3, 200.0), np.eye(3), np.zeros(3)
    return draw_mesh(image, vertices, faces, grey, K, eye, zero, **how)


def painted(image, vertices, faces, **how):
    """That of films."""
    return paint_mesh(image, vertices, faces, K, np.full(3, 200.0), **how)


both = pytest.mark.parametrize("draw", [exact, painted])


@both
def test_a_ball_covers_the_disc_that_geometry_demands(draw):
    vertices, faces = sphere(0.5, rings=48)
    drawn = draw(np.zeros((48, 64, 3), np.uint8), vertices + [0, 0, 3.0], faces, light=FLAT)
    edge_px = 0.25 * (draw is painted)  # half a fine pixel
    area_px = np.pi * (80 * 0.5 / np.sqrt(3.0**2 - 0.5**2) + edge_px) ** 2
    assert drawn[..., 0].sum() / 200.0 == pytest.approx(area_px, rel=0.02 if edge_px else 0.01)
    rows, columns = np.nonzero(drawn[..., 0])
    assert np.allclose([columns.mean(), rows.mean()], [31.5, 23.5], atol=0.15)


@both
def test_the_nearer_ball_hides_the_farther_one(draw):
    vertices, faces = sphere(0.3)
    lit = Light(towards_lamp=(0.0, 0.0, -1.0), up=(0.0, -1.0, 0.0), ambient=0, diffuse=1, sky=0)
    near = draw(_paper(), vertices + [0, 0, 2.0], faces, light=lit)
    for first, second in ((2.0, 3.0), (3.0, 2.0)):
        balls = np.concatenate([vertices + [0, 0, first], vertices + [0, 0, second]])
        drawn = draw(_paper(), balls, np.concatenate([faces, faces + len(vertices)]), light=lit)
        np.testing.assert_array_equal(drawn, near)


@both
def test_alpha_blends_and_the_picture_given_is_left_alone(draw):
    vertices, faces = sphere(0.5)
    image = _paper()
    half = draw(image, vertices + [0, 0, 3.0], faces, alpha=0.5, light=FLAT)
    assert half[24, 32, 0] == pytest.approx(150, abs=1)
    assert (half[0, 0] == 100).all()
    assert (image == 100).all()
    assert (draw(image, vertices + [0, 0, 3.0], faces, alpha=0.0) == image).all()


@both
@pytest.mark.parametrize("t", [(0, 0, -3.0), (40.0, 0, 3.0)], ids=["behind", "beside"])
def test_a_mesh_out_of_sight_changes_nothing(draw, t):
    vertices, faces = sphere(0.5)
    assert (draw(_paper(), vertices + t, faces) == 100).all()


def _paper() -> np.ndarray:
    return np.full((48, 64, 3), 100, np.uint8)
