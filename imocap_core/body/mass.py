"""Centre of mass of a body from its joints.

Shares of the body's mass and the place of each segment's centre along it: de Leva, Adjustments to
Zatsiorsky-Seluyanov's segment inertia parameters, J. Biomechanics 29 (1996), men. The numbers have
not been compared with the printed edition; a centimetre or two is all that balance asks for.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from imocap_core.conventions import SMPL_JOINTS

# proximal joint, distal joint, share of the mass, centre from the proximal to the distal joint
MIDDLE_SEGMENTS = (
    ("neck", "head", 0.0694, 1.2),
    ("pelvis", "spine1", 0.1117, 0.3),
    ("spine1", "spine3", 0.1633, 0.5),
    ("spine3", "neck", 0.1596, 0.5),
)
LIMB_SEGMENTS = (
    ("shoulder", "elbow", 0.0271, 0.58),
    ("elbow", "wrist", 0.0162, 0.46),
    ("wrist", "hand", 0.0061, 0.5),
    ("hip", "knee", 0.1416, 0.41),
    ("knee", "ankle", 0.0433, 0.45),
    ("ankle", "foot", 0.0137, 0.5),
)


def _joint_shares() -> Float[np.ndarray, "24"]:
    segments = list(MIDDLE_SEGMENTS)
    for side in ("left", "right"):
        segments += [
            (f"{side}_{a}", f"{side}_{b}", share, where) for a, b, share, where in LIMB_SEGMENTS
        ]
    shares = np.zeros(len(SMPL_JOINTS))
    for proximal, distal, share, where in segments:
        shares[SMPL_JOINTS.index(proximal)] += share * (1 - where)
        shares[SMPL_JOINTS.index(distal)] += share * where
    return np.asarray(shares / shares.sum())


JOINT_MASS_SHARES = _joint_shares()
"""(24,) weights of SMPL's joints whose weighted mean is the body's centre of mass."""


def centre_of_mass(joints: Float[np.ndarray, "*T 24 3"]) -> Float[np.ndarray, "*T 3"]:
    """Centre of mass, in the joints' axes and unit."""
    return np.einsum("j,...jc->...c", JOINT_MASS_SHARES, joints)
