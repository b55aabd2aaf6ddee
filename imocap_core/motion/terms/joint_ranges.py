"""Anatomical ranges of every joint, as bounds of the components of its axis-angle vector.

Axes are those of the body at rest (T-pose, palms down): x to the body's left, y up, z forward.
Every range is the wider one of the sources, so that it bounds what a healthy adult can do, not what
is usual:

* limbs: American Academy of Orthopaedic Surgeons, Joint Motion: Method of Measuring and Recording
  (1965), the active norms; Kapandji, The Physiology of the Joints, volumes 1 and 2, where passive
  motion goes further (hip, knee, ankle, wrist).
* collar: Inman, Saunders and Abbott, Observations on the function of the shoulder joint (1944):
  rotation of the clavicle; Kapandji, volume 1: elevation, protraction.
* spine, neck, head: White and Panjabi, Clinical Biomechanics of the Spine (2nd edition, 1990),
  representative ranges of the motion segments. Each joint of the body has the sum of the segments
  nearest to it: spine1 L1 to S1, spine2 T9 to L1, spine3 T1 to T9, neck C2 to T1, head C0 to C2.
  Combined flexion and extension are divided 3 : 1 (AAOS: 80 and 25 degrees of the trunk), and
  equally for neck and head (AAOS: 45 and 45).

The numbers have not been compared with the printed editions; do that before a default depends on
them. Where joints share a motion, each has all of it, because a fit may put it into either:
elevation of the arm (shoulder, though the scapula carries a third of it), supination (elbow and
wrist). Bounds on components are exact for rotations about one axis, otherwise an approximation.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from imocap_core.conventions import SMPL_JOINTS

FREE = (-math.inf, math.inf)
Bounds = tuple[float, float]


class ComponentRange(NamedTuple):
    """Bounds of one component (0 x, 1 y, 2 z) of a joint's axis-angle vector, radians."""

    joint: int
    component: int
    lower_rad: float
    upper_rad: float


# (lower, upper) of x, y, z in degrees
_MIDDLE_DEG: dict[str, tuple[Bounds, Bounds, Bounds]] = {
    # flexion +x, turn to the left +y, side-bend to the right +z
    "spine1": ((-19, 56), (-9, 9), (-29, 29)),
    "spine2": ((-10, 29), (-10, 10), (-30, 30)),
    "spine3": ((-9, 28), (-61, 61), (-46, 46)),
    "neck": ((-46, 46), (-32, 32), (-51, 51)),
    "head": ((-23, 23), (-45, 45), (-10, 10)),
}
_LEFT_DEG: dict[str, tuple[Bounds, Bounds, Bounds]] = {
    # flexion -x, internal rotation -y, abduction +z
    "hip": ((-145, 30), (-45, 60), (-30, 45)),
    # flexion +x, internal rotation of the flexed knee -y
    "knee": ((0, 160), (-30, 40), FREE),
    # dorsiflexion -x, adduction -y, inversion -z
    "ankle": ((-30, 50), (-20, 20), (-52, 30)),
    # of the toes: extension -x
    "foot": ((-90, 45), FREE, FREE),
    # backward rotation -x, protraction -y, elevation +z
    "collar": ((-50, 10), (-30, 30), (-10, 45)),
    # external rotation -x, horizontal flexion -y, elevation +z
    "shoulder": ((-90, 90), (-140, 45), (-120, 90)),
    # supination -x, flexion -y
    "elbow": ((-170, 10), (-160, 0), FREE),
    # supination -x, radial deviation -y, flexion -z
    "wrist": ((-170, 10), (-20, 45), (-85, 85)),
    # of the fingers: flexion -z
    "hand": (FREE, FREE, (-90, 45)),
}


def _component_ranges() -> tuple[ComponentRange, ...]:
    table = dict(_MIDDLE_DEG)
    for name, (x, y, z) in _LEFT_DEG.items():
        table[f"left_{name}"] = (x, y, z)
        table[f"right_{name}"] = (x, (-y[1], -y[0]), (-z[1], -z[0]))  # mirrored: x -> -x
    return tuple(
        ComponentRange(SMPL_JOINTS.index(name), k, math.radians(lower), math.radians(upper))
        for name, bounds in sorted(table.items(), key=lambda item: SMPL_JOINTS.index(item[0]))
        for k, (lower, upper) in enumerate(bounds)
        if (lower, upper) != FREE
    )


JOINT_RANGES = _component_ranges()
"""All joints but the pelvis, whose orientation is free."""

# joint, axis-angle component, sign in which it flexes
HINGES = (
    ("left_knee", 0, 1.0),
    ("right_knee", 0, 1.0),
    ("left_elbow", 1, -1.0),
    ("right_elbow", 1, 1.0),
)
HINGE_RANGES = tuple(
    ComponentRange(SMPL_JOINTS.index(name), k, *((0.0, math.inf) if sign > 0 else (-math.inf, 0.0)))
    for name, k, sign in HINGES
)
"""Knees and elbows do not bend backwards; nothing else is bounded."""
