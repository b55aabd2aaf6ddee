"""SMPL-family body models as immutable values: Model -> Shaped -> Posed -> Mesh, and keypoints."""

from imocap_core.body.free import load_free_body
from imocap_core.body.layouts import layout_names, layouts
from imocap_core.body.model import (
    Mesh,
    Model,
    Posed,
    Shaped,
    all_joints,
    keypoints_with_jacobian,
    points_with_blocks,
)
from imocap_core.body.points import PointSet, join_points, make_points, pick_points

__all__ = [
    "Mesh",
    "Model",
    "PointSet",
    "Posed",
    "Shaped",
    "all_joints",
    "join_points",
    "keypoints_with_jacobian",
    "layout_names",
    "layouts",
    "load_free_body",
    "make_points",
    "pick_points",
    "points_with_blocks",
]
