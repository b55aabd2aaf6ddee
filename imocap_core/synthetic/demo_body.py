"""The body of the demos: its kinematics for contacts, its colours for the picture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float, Int

from imocap_core.body import Shaped, keypoints_with_jacobian, make_points
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.synthetic.contact import POINTS, SKIN, Forward

# RGB by part of the body; the parts are those of the free body's faces
_PALETTE: dict[str, tuple[int, int, int]] = {
    "skin": (214, 165, 137),
    "hair": (58, 40, 30),
    "shirt": (196, 62, 58),
    "trousers": (44, 52, 84),
    "shoes": (232, 228, 220),
}


def contact_forward(shaped: Shaped) -> Forward:
    """Forward kinematics for contact.solve_contacts: numpy, pelvis position for translation.

    shaped: one body, coefficients (n,).
    """
    root = shaped.joints_rest[0]
    model = shaped.model
    joints = [{index: 1.0} for index in range(len(SMPL_JOINTS))]
    skin = [dict(model.landmarks[name]) for name in SKIN]
    nothing: dict[int, float] = {}
    points = make_points(
        model, POINTS, joints + [nothing] * len(skin), [nothing] * len(joints) + skin
    )

    def forward(
        R_local: Float[np.ndarray, "N 24 3 3"], pelvis: Float[np.ndarray, "N 3"]
    ) -> tuple[Float[np.ndarray, "N P 3"], Float[np.ndarray, "N P 3 72"]]:
        transl = torch.as_tensor(pelvis, dtype=root.dtype) - root
        rotations = torch.as_tensor(R_local, dtype=root.dtype)
        xyz, d_pose, _ = keypoints_with_jacobian(shaped, points, rotations, transl)
        return xyz.numpy(), d_pose.numpy()

    return forward


def outfit(
    face_parts: Int[np.ndarray, " F"], part_names: Sequence[str], rng: np.random.Generator
) -> Float[np.ndarray, "F 3"]:
    """RGB colour of every face: the palette, with randomly tinted clothes."""
    colors = np.array([_PALETTE[name] for name in part_names], dtype=np.float64)
    clothes = [i for i, name in enumerate(part_names) if name in ("shirt", "trousers", "shoes")]
    colors[clothes] = np.clip(colors[clothes] + rng.normal(0, 30, (len(clothes), 3)), 15, 245)
    return colors[face_parts]
