"""Joint angles by ISB's recommendations, in degrees.

Wu et al. 2002 (hip, ankle, spine), Grood & Suntay 1983 (knee), Wu et al. 2005 (shoulder, elbow,
wrist); pelvis in the world after Baker 2001. Signs are those that clinicians use, the same on both
sides: flexion, adduction, internal rotation, dorsiflexion, inversion, pronation and ulnar deviation
are positive (`MEANING`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.biomechanics.cardan import continuous, yxy, yxz, zxy
from imocap_core.biomechanics.segments import anatomical_axes
from imocap_core.conventions import SIDES, Side

ZXY, YXY, YXZ = "zxy", "yxy", "yxz"
WORLD = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])  # X = z, Y = y, Z = -x
DECOMPOSITIONS = {ZXY: zxy, YXY: yxy, YXZ: yxz}


@dataclass(frozen=True)
class JointDefinition:
    """One joint: the segments on its sides, the order of its axes, and its three angles.

    angles: name and sign of each. proximal: None for the world.
    """

    proximal: str | None
    distal: str
    order: str
    angles: tuple[tuple[str, float], tuple[str, float], tuple[str, float]]


MIDDLE = {
    "pelvis": JointDefinition(
        None, "pelvis", YXZ, (("rotation", 1), ("obliquity", -1), ("tilt", -1))
    ),
    "trunk": JointDefinition(
        "pelvis", "thorax", ZXY, (("flexion", -1), ("right_bending", 1), ("left_rotation", 1))
    ),
    "neck": JointDefinition(
        "thorax", "head", ZXY, (("flexion", -1), ("right_bending", 1), ("left_rotation", 1))
    ),
}
PAIRED = {
    "hip": JointDefinition(
        "pelvis", "thigh", ZXY, (("flexion", 1), ("adduction", 1), ("internal_rotation", 1))
    ),
    "knee": JointDefinition(
        "thigh", "shank", ZXY, (("flexion", -1), ("adduction", 1), ("internal_rotation", 1))
    ),
    "ankle": JointDefinition(
        "shank", "foot", ZXY, (("dorsiflexion", 1), ("inversion", 1), ("internal_rotation", 1))
    ),
    "shoulder": JointDefinition(
        "thorax", "humerus", YXY, (("plane", 1), ("elevation", 1), ("internal_rotation", 1))
    ),
    "elbow": JointDefinition(
        "humerus", "forearm", ZXY, (("flexion", 1), ("adduction", 1), ("pronation", 1))
    ),
    "wrist": JointDefinition(
        "forearm", "hand", ZXY, (("flexion", 1), ("ulnar_deviation", 1), ("rotation", 1))
    ),
}
# What the model cannot tell: carrying angle and knee's varus are nearly constant in a person, and
# all of the twist below the elbow is pronation.
LEFT_OUT = ("wrist_rotation",)


ANATOMICAL_JOINTS = (*MIDDLE, *(f"{side}_{joint}" for joint in PAIRED for side in SIDES))


def definition_of(joint: str) -> tuple[Side, JointDefinition]:
    """Side and definition of one of `ANATOMICAL_JOINTS`; those of the middle are not mirrored."""
    for side in SIDES:
        if joint.startswith(f"{side}_"):
            return side, PAIRED[joint.removeprefix(f"{side}_")]
    return "right", MIDDLE[joint]


def angle_names() -> tuple[str, ...]:
    """The names of all angles: those of the middle, then `left_` and `right_` of each limb."""
    middle = [f"{j}_{name}" for j, of in MIDDLE.items() for name, _ in of.angles]
    limbs = [
        f"{side}_{j}_{name}"
        for j, of in PAIRED.items()
        for side in SIDES
        for name, _ in of.angles
        if f"{j}_{name}" not in LEFT_OUT
    ]
    return (*middle, *limbs)


def joint_angles_deg(
    R_local: Float[np.ndarray, "T 24 3 3"], rest_m: Float[np.ndarray, "24 3"]
) -> dict[str, Float[np.ndarray, " T"]]:
    """Every angle of `angle_names` over time, degrees, without jumps of a whole turn.

    Args:
        R_local: rotations of SMPL's joints against their parents, the first in a world whose y
            points up.
        rest_m: the joints of the rest pose, metres.
    """
    by_name = joint_angles_rad(R_local, rest_m, DECOMPOSITIONS)
    return {name: np.degrees(angle) for name, angle in by_name.items()}


def joint_angles_rad(
    R_local: Float[np.ndarray, "T 24 3 3"],
    rest_m: Float[np.ndarray, "24 3"],
    decompositions: Mapping[str, Callable[[np.ndarray], np.ndarray]],
) -> dict[str, Float[np.ndarray, " T"]]:
    """The same in radians, with rotations taken apart by other functions of the same orders."""
    by_name: dict[str, Float[np.ndarray, " T"]] = {}
    for side in SIDES:
        axes = anatomical_axes(R_local, rest_m, side)
        for joint, of in PAIRED.items():
            by_name |= _angles_of(f"{side}_{joint}", of, axes, decompositions)
        if side == "right":  # not mirrored
            for joint, of in MIDDLE.items():
                by_name |= _angles_of(joint, of, axes, decompositions)
    return {name: by_name[name] for name in angle_names()}


def distal_in_proximal(
    of: JointDefinition, axes: Mapping[str, Float[np.ndarray, "T 3 3"]]
) -> Float[np.ndarray, "T 3 3"]:
    """Rotation of a joint: the distal segment's axes in those of the proximal one."""
    proximal = WORLD if of.proximal is None else axes[of.proximal]
    return np.asarray(np.swapaxes(proximal, -1, -2) @ axes[of.distal])


def _angles_of(
    prefix: str,
    of: JointDefinition,
    axes: Mapping[str, Float[np.ndarray, "T 3 3"]],
    decompositions: Mapping[str, Callable[[np.ndarray], np.ndarray]],
) -> dict[str, Float[np.ndarray, " T"]]:
    angles = decompositions[of.order](distal_in_proximal(of, axes))
    return {
        f"{prefix}_{name}": continuous(sign * angles[:, i])
        for i, (name, sign) in enumerate(of.angles)
    }
