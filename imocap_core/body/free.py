"""The free body that ships with the package: SMPL's kinematic tree and format, CC0 data.

Made by tools/make_free_body.py from MakeHuman's CC0 mesh, bones and shape targets; see
data/free_body.LICENSE.md and data/free_body.PROVENANCE.md. 13,492 vertices, 10 betas of unit
variance, pelvis at the origin of the rest pose, mean stature 1.70 m.
"""

from __future__ import annotations

import hashlib
from functools import lru_cache
from importlib import resources

import numpy as np
import torch

from imocap_core.body.kinematics import Landmark
from imocap_core.body.model import Model
from imocap_core.conventions import SMPL_JOINTS, SMPLH_JOINTS


def load_free_body(
    device: torch.device | str = "cpu", dtype: torch.dtype = torch.float64, hands: bool = False
) -> Model:
    """The free body with SMPL's 24 joints, or with SMPL+H's 52 (fingers) when `hands`."""
    arrays = _arrays()
    prefix = "hands_" if hands else ""

    def tensor(name: str) -> torch.Tensor:
        return torch.as_tensor(arrays[name], device=device).to(dtype)

    weights = tensor(prefix + "weights")
    regressor = tensor(prefix + "J_regressor")
    tree = arrays[prefix + "kintree_table"]
    return Model(
        name="free_body_hands" if hands else "free_body",
        joint_names=SMPLH_JOINTS if hands else SMPL_JOINTS,
        parents=tuple(int(parent) for parent in tree[0]),
        v_template=tensor("v_template"),
        shapedirs=tensor("shapedirs"),
        J_regressor=regressor / regressor.sum(1, keepdim=True),  # float32 on disk: sum to 1 again
        weights=weights / weights.sum(1, keepdim=True),
        faces=torch.as_tensor(arrays["f"].astype(np.int64), device=device),
        digest=_digest(prefix),
        landmarks=_landmarks(),
        face_parts=torch.as_tensor(arrays["face_parts"].astype(np.int64), device=device),
        part_names=tuple(str(name) for name in arrays["part_names"]),
    )


@lru_cache(maxsize=1)
def _arrays() -> dict[str, np.ndarray]:
    source = resources.files("imocap_core.body") / "data" / "free_body.npz"
    with source.open("rb") as stream, np.load(stream) as archive:
        return {name: archive[name] for name in archive.files}


@lru_cache(maxsize=2)
def _digest(prefix: str) -> str:
    arrays = _arrays()
    names = ("v_template", "shapedirs", f"{prefix}weights", f"{prefix}J_regressor")
    total = hashlib.sha256()
    for name in (*names, f"{prefix}kintree_table"):
        array = arrays[name]
        total.update(f"{array.dtype.str}{array.shape}".encode())
        total.update(np.ascontiguousarray(array).tobytes())
    return total.hexdigest()


@lru_cache(maxsize=1)
def _landmarks() -> dict[str, Landmark]:
    arrays = _arrays()
    marks: dict[str, Landmark] = {}
    rows = zip(
        arrays["landmark_names"],
        arrays["landmark_vertices"],
        arrays["landmark_weights"].astype(np.float64),
        strict=True,
    )
    for name, vertices, weights in rows:
        total = weights.sum()
        marks[str(name)] = tuple(
            (int(v), float(w / total)) for v, w in zip(vertices, weights, strict=True) if w != 0
        )
    return marks
