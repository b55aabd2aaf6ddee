"""Constants of the field: kinematic trees of the SMPL family, and the joints of evaluations.

Names are lower snake case and start with ``left_`` or ``right_`` where the body has two of them
(from the performer's point of view). Every layout of the project uses these names.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

# SMPL's 24 joints, in SMPL's order (Loper et al., SIGGRAPH Asia 2015).
SMPL_JOINTS: tuple[str, ...] = (
    "pelvis",
    "left_hip",
    "right_hip",
    "spine1",
    "left_knee",
    "right_knee",
    "spine2",
    "left_ankle",
    "right_ankle",
    "spine3",
    "left_foot",
    "right_foot",
    "neck",
    "left_collar",
    "right_collar",
    "head",
    "left_shoulder",
    "right_shoulder",
    "left_elbow",
    "right_elbow",
    "left_wrist",
    "right_wrist",
    "left_hand",
    "right_hand",
)
JOINTS = len(SMPL_JOINTS)
SMPL_PARENTS: tuple[int, ...] = (
    *(-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8),
    *(9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21),
)

_FINGERS = ("index", "middle", "pinky", "ring", "thumb")  # SMPL+H's order (Romero et al., 2017)


def _hand(side: str) -> tuple[str, ...]:
    return tuple(f"{side}_{finger}{knuckle}" for finger in _FINGERS for knuckle in (1, 2, 3))


# SMPL+H's 52 joints: SMPL's first 22, then 15 of the left hand and 15 of the right.
SMPLH_JOINTS: tuple[str, ...] = (*SMPL_JOINTS[:22], *_hand("left"), *_hand("right"))
SMPLH_PARENTS: tuple[int, ...] = (
    *SMPL_PARENTS[:22],
    *((20, 22, 23, 20, 25, 26, 20, 28, 29, 20, 31, 32, 20, 34, 35)),
    *((21, 37, 38, 21, 40, 41, 21, 43, 44, 21, 46, 47, 21, 49, 50)),
)

# The evaluation joints (docs/metrics.md): the 12 of the authors' tables, then two common supersets.
# Each is the name of an SMPL joint, or of a point of `body.Model.points`.
EVAL_12: tuple[str, ...] = (
    "right_ankle",
    "right_knee",
    "right_hip",
    "left_hip",
    "left_knee",
    "left_ankle",
    "right_wrist",
    "right_elbow",
    "right_shoulder",
    "left_shoulder",
    "left_elbow",
    "left_wrist",
)
EVAL_INDICES = [SMPL_JOINTS.index(name) for name in EVAL_12]
EVAL_14: tuple[str, ...] = (*EVAL_12, "neck", "head")
EVAL_17: tuple[str, ...] = (*EVAL_12, "pelvis", "spine2", "neck", "nose", "head")

Side = Literal["left", "right"]
SIDES: tuple[Side, ...] = ("left", "right")
LIMB_BONES = (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist"))


def swap_side(name: str) -> str:
    """Name of the same point of the other side: left_knee -> right_knee; others are unchanged."""
    if name.startswith("left_"):
        return "right_" + name.removeprefix("left_")
    if name.startswith("right_"):
        return "left_" + name.removeprefix("right_")
    return name


def sideless(name: str) -> str:
    """Name without its side: left_knee and right_knee -> knee; others are unchanged."""
    return name.removeprefix("left_").removeprefix("right_")


OTHER = "other"  # the same point of the other side


def point_towards(name: str, target: str) -> str:
    """Name of the `target` (without its side) of the same side; for `OTHER`, of the other side."""
    side = name[: len(name) - len(sideless(name))]
    return swap_side(name) if target == OTHER else side + target


def mirror_indices(names: Sequence[str]) -> tuple[int, ...]:
    """For each name the index of the same point of the other side, or of itself without one.

    Names may repeat, one layout after another: the first belongs to the first, and so on.
    """
    places: dict[str, list[int]] = {}
    for i, name in enumerate(names):
        places.setdefault(name, []).append(i)
    twins = list(range(len(names)))
    for name, mine in places.items():
        for i, twin in zip(mine, places.get(swap_side(name), mine), strict=False):
            twins[i] = twin
    return tuple(twins)


def left_right_pairs(names: Sequence[str]) -> tuple[tuple[int, int], ...]:
    """Index pairs (left, right) of a list of names."""
    return tuple(
        (i, j)
        for i, j in enumerate(mirror_indices(names))
        if i != j and names[i].startswith("left_")
    )
