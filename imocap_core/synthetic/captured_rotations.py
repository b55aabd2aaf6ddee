"""How the rigid segments of a captured skeleton turn, relative to its neutral stance."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from imocap_core.synthetic.captured_stance import CapturedSkeleton, NeutralStance


def rotations_from_stance(
    skeleton: CapturedSkeleton, stance: NeutralStance, xyz: Float[np.ndarray, "T J 3"]
) -> Float[np.ndarray, "3 T 3 3"]:
    """Rotations of pelvis, chest and head from the neutral stance's body axes to the world."""
    return np.stack(
        [
            rotations_between(stance.vectors[segment], skeleton.rigid_points(xyz, segment)[0])
            for segment in (skeleton.pelvis, skeleton.chest, skeleton.head)
        ]
    )


def rotations_between(
    template: Float[np.ndarray, "C 3"], observed: Float[np.ndarray, "T C 3"]
) -> Float[np.ndarray, "T 3 3"]:
    """The rotations that turn a template's vectors best into the observed ones (Kabsch 1976)."""
    U, _, Vt = np.linalg.svd(np.einsum("tci,cj->tij", observed, template))
    U[:, :, 2] *= np.sign(np.linalg.det(U @ Vt))[:, None]
    rotation: np.ndarray = U @ Vt
    return rotation
