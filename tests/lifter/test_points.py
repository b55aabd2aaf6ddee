"""Layouts meet in the common points."""

import re

import numpy as np
import pytest
import torch

from imocap_core.body import load_free_body
from imocap_core.body.layouts import layout_keypoints
from imocap_core.lifter.lifter_network import COMMON, MIRROR, can_lift, columns_of, to_common

LAYOUTS = (
    "body25",
    "body25b",
    "coco17",
    "coco18",
    "halpe26",
    "h36m17",
    "mediapipe33",
    "blazepose33",
)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_column_goes_to_the_point_it_sits_at(layout: str) -> None:
    columns, rows = columns_of(layout)
    keypoints = layout_keypoints(layout)
    points = [re.sub("_(mediapipe|blazepose)$", "", keypoints[c].point) for c in columns]
    assert points == [COMMON[r] for r in rows]
    assert len(rows) >= 15


def test_two_detectors_of_one_body_say_the_same() -> None:
    """What BODY_25 and Halpe-26 see of a body lands at the same places."""
    model = load_free_body()
    posed = model.shape(model.v_template.new_zeros(1, 10))
    eye = torch.eye(3, dtype=torch.float64).expand(1, 24, 3, 3)
    body = posed.pose(eye, model.v_template.new_zeros(1, 3))
    common = {}
    for layout in ("body25", "halpe26"):
        xy = body.keypoints(model.points(layout))[..., :2].numpy()
        common[layout] = to_common(xy, np.ones(xy.shape[:2]), layout)
    (a, trust_a), (b, trust_b) = common["body25"], common["halpe26"]
    both = (trust_a > 0) & (trust_b > 0)
    assert both.sum() >= 22
    np.testing.assert_allclose(a[both], b[both], atol=1e-12)


def test_missing_points_are_zero_without_confidence() -> None:
    xy = np.full((2, 17, 2), np.nan)
    xy[:, 5] = 3.0
    points, trust = to_common(xy, np.full((2, 17), 2.0), "coco17")
    assert np.isfinite(points).all()
    assert trust.sum() == 2.0  # one point a frame, cut off at 1
    assert (points[trust > 0] == 3.0).all()


def test_mirroring_twice_changes_nothing() -> None:
    assert [MIRROR[i] for i in MIRROR] == list(range(len(COMMON)))


def test_hands_alone_are_too_little() -> None:
    assert not can_lift("left_hand21")
    assert can_lift("coco17")
    with pytest.raises(ValueError, match="left_hand21"):
        columns_of("left_hand21")
