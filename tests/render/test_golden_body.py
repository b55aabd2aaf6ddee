"""One fixed pose of the free body against its committed picture."""

from pathlib import Path

import cv2
import numpy as np
import torch

from imocap_core import rotations
from imocap_core.body import load_free_body
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.render import VIEWS, common_scale, draw_view, heading_of, segment_colors

GOLDEN = Path(__file__).parent / "golden" / "body.png"
SIZE = (120, 150)
POSE_RAD = {  # axis-angle
    "pelvis": (0.1, 0.4, 0.0),
    "spine1": (0.2, 0.1, 0.0),
    "spine3": (0.0, 0.2, 0.1),
    "neck": (0.1, 0.0, 0.0),
    "left_hip": (-0.9, 0.0, 0.1),
    "left_knee": (1.2, 0.0, 0.0),
    "left_shoulder": (0.0, 0.0, -1.0),
    "left_elbow": (0.0, -1.0, 0.0),
    "right_shoulder": (0.0, 0.3, 0.6),
}
AGAIN = "after an intended change run `python -m tests.render.test_golden_body` and look at it"


def drawn() -> np.ndarray:
    """The pose from front, side and back, (150, 360, 3) RGB."""
    model = load_free_body()
    theta = torch.zeros(len(SMPL_JOINTS), 3, dtype=torch.float64)
    for name, axis_angle in POSE_RAD.items():
        theta[SMPL_JOINTS.index(name)] = torch.tensor(axis_angle, dtype=torch.float64)
    R_local = rotations.exp(theta)
    shaped = model.shape(torch.zeros(model.num_betas, dtype=torch.float64))
    posed = shaped.pose(R_local, torch.zeros(3, dtype=torch.float64))
    vertices, faces = posed.mesh().vertices.numpy(), model.faces.numpy()
    vertices = vertices - [0.0, vertices[:, 1].min(), 0.0]
    heading = heading_of(R_local[0].numpy())
    colors = segment_colors(model.weights.numpy(), model.joint_names, faces)
    px_per_m = common_scale(vertices[None], heading[None], SIZE)
    views = [draw_view(vertices, faces, colors, heading, v, SIZE, px_per_m) for v in VIEWS]
    return np.concatenate(views, axis=1)


def test_a_fixed_pose_looks_as_its_committed_picture() -> None:
    stored = cv2.imread(str(GOLDEN), cv2.IMREAD_COLOR)
    assert stored is not None, f"{GOLDEN} cannot be read; {AGAIN}"
    golden, now = stored[:, :, ::-1].astype(float), drawn().astype(float)
    assert now.shape == golden.shape, f"{GOLDEN.name}: another size; {AGAIN}"
    difference = np.abs(now - golden).max(axis=2)
    changed = float((difference > 24).mean())  # levels of 255, beyond rounding at edges
    assert changed < 0.002, f"{GOLDEN.name}: {100 * changed:.2f} % of the pixels differ; {AGAIN}"
    assert difference.mean() < 0.3, f"{GOLDEN.name}: other shades; {AGAIN}"


def test_the_picture_would_show_a_bent_spine(monkeypatch) -> None:
    monkeypatch.setitem(POSE_RAD, "spine1", (0.35, 0.1, 0.0))  # 9 degrees more
    golden = cv2.imread(str(GOLDEN), cv2.IMREAD_COLOR)[:, :, ::-1].astype(float)
    difference = np.abs(drawn().astype(float) - golden).max(axis=2)
    assert (difference > 24).mean() > 0.01


if __name__ == "__main__":
    GOLDEN.parent.mkdir(exist_ok=True)
    cv2.imwrite(str(GOLDEN), drawn()[:, :, ::-1])
