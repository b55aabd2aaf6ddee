"""Laws of the views from front, side and back."""

import numpy as np
import pytest
import torch

from imocap_core import rotations
from imocap_core.body import load_free_body
from imocap_core.render import (
    GROUND_RGB,
    PAPER_RGB,
    SEGMENT_RGB,
    SKIN_RGB,
    UP,
    VIEWS,
    common_scale,
    draw_view,
    heading_of,
    segment_colors,
    view_rotation,
)

SIZE = (80, 100)


def _rotation(*axis_angle: float) -> np.ndarray:
    return rotations.exp(torch.tensor(axis_angle, dtype=torch.float64)).numpy()


@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.5])
def test_a_turned_body_has_the_same_heading_however_it_bends(yaw: float) -> None:
    turned, expected = _rotation(0, yaw, 0), np.array([np.sin(yaw), 0, np.cos(yaw)])
    for bend in (0.0, 0.9, np.pi / 2, -np.pi / 2):  # upright, bent, on the front, on the back
        assert np.allclose(heading_of(turned @ _rotation(bend, 0, 0)), expected)
    for lean in (0.8, np.pi / 2):  # to the side
        assert np.allclose(heading_of(turned @ _rotation(0, 0, lean)), expected)


@pytest.mark.parametrize("view", VIEWS)
def test_cameras_are_level_and_proper(view: str) -> None:
    R = view_rotation(np.array([0.6, 0.0, 0.8]), view)
    assert np.allclose(R @ R.T, np.eye(3))
    assert np.linalg.det(R) == pytest.approx(1)
    assert np.allclose(R @ UP, [0, -1, 0])


def test_where_the_body_faces_and_where_its_left_is() -> None:
    heading, left = np.array([0.0, 0, 1]), np.array([1.0, 0, 0])
    assert np.allclose(view_rotation(heading, "front") @ heading, [0, 0, -1])
    assert np.allclose(view_rotation(heading, "front") @ left, [1, 0, 0])
    assert np.allclose(view_rotation(heading, "side") @ heading, [1, 0, 0])
    assert np.allclose(view_rotation(heading, "side") @ left, [0, 0, 1])
    assert np.allclose(view_rotation(heading, "back") @ heading, [0, 0, 1])
    with pytest.raises(ValueError, match="view: expected one of front, side, back, got 'above'"):
        view_rotation(heading, "above")


@pytest.mark.parametrize("view", VIEWS)
def test_the_whole_body_is_in_the_middle_over_the_ground(view: str) -> None:
    model, heading = load_free_body(), np.array([0.0, 0, 1])
    body = model.v_template.numpy()
    body = body - body[:, 1].min() * UP + [5.0, 0, -3]
    faces = model.faces.numpy()
    colors = np.full((len(faces), 3), 100.0)
    px_per_m = common_scale(body[None], heading[None], SIZE)
    picture = draw_view(body, faces, colors, heading, view, SIZE, px_per_m)
    assert picture.shape == (100, 80, 3)
    paper = (picture == PAPER_RGB).all(axis=2)
    line = (picture == GROUND_RGB).all(axis=2)
    rows, columns = np.nonzero(~paper & ~line)
    assert columns.min() + columns.max() == pytest.approx(79, abs=2)
    assert rows.min() > 0
    assert rows.max() - rows.min() == pytest.approx(px_per_m * np.ptp(body[:, 1]), abs=2)
    (ground,) = np.flatnonzero(line.any(axis=1))
    assert ground == pytest.approx(rows.max(), abs=1)


def test_the_bands_of_the_torso_rise_in_order() -> None:
    model = load_free_body()
    faces, height = model.faces.numpy(), model.v_template[:, 1].numpy()
    colors = segment_colors(model.weights.numpy(), model.joint_names, faces)
    middles = []
    for name in ("pelvis", "spine1", "spine2", "spine3", "neck"):
        band = (colors == SEGMENT_RGB[name]).all(axis=1)
        assert band.sum() > 50
        middles.append(height[faces[band]].mean())
    assert middles == sorted(middles)
    assert (colors == SKIN_RGB).all(axis=1).mean() > 0.5
