"""Body models as immutable values: Model -> Shaped -> Posed -> Mesh, keypoints, derivatives."""

from imocap_core.body.jacobian import keypoints_with_jacobian
from imocap_core.body.model import Mesh, Model, Posed, Shaped
from imocap_core.body.points import PointSet, make_points

__all__ = [
    "Mesh",
    "Model",
    "PointSet",
    "Posed",
    "Shaped",
    "keypoints_with_jacobian",
    "make_points",
]
