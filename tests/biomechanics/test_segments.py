"""Surface markers: on both sides alike, and rigid with their segments."""

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from imocap_core.biomechanics.segments import marker_vertices, surface_markers
from imocap_core.body import load_free_body

BODY = load_free_body()
VERTICES = marker_vertices(
    BODY.v_template.numpy(), BODY.weights.numpy(), BODY.joints_template.numpy(), BODY.joint_names
)


def test_both_sides_have_the_same_markers() -> None:
    places = {name: BODY.v_template.numpy()[vertex] for name, vertex in VERTICES.items()}
    assert set(places) == set(surface_markers())
    assert len(set(VERTICES.values())) == len(VERTICES)
    for name, place in places.items():
        if name.startswith("left_"):
            mirrored = place * [-1, 1, 1]
            assert np.linalg.norm(places["right_" + name[5:]] - mirrored) < 0.005


def test_markers_move_with_their_segments() -> None:
    rng = np.random.default_rng(6)
    turns = Rotation.from_rotvec(0.4 * rng.normal(size=(24, 3))).as_matrix()
    shaped = BODY.shape(torch.as_tensor(rng.normal(size=10)))
    posed = shaped.pose(torch.as_tensor(turns[None]), torch.zeros((1, 3), dtype=torch.float64))
    R = [turns[0]]
    for joint, parent in enumerate(BODY.parents[1:], start=1):
        R.append(R[parent] @ turns[joint])
    for name, of in surface_markers().items():
        side = name.split("_")[0]
        joint = BODY.joint_names.index(
            of.joint if of.joint in BODY.joint_names else f"{side}_{of.joint}"
        )
        at_rest = shaped.vertices_rest[VERTICES[name]] - shaped.joints_rest[joint]
        now = posed.mesh().vertices[0, VERTICES[name]] - posed.joints[0, joint]
        away_m = np.linalg.norm(now.numpy() - R[joint] @ at_rest.numpy())
        assert away_m < 0.02, name
