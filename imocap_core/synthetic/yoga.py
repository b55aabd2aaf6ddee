"""Keyframes of the demo's choreographies (poses.toml): anatomical degrees, as SMPL's rotations.

Axes: y up, the origin on the floor; the performer faces +z, with +x to the left, as in the body's
rest pose. Angles are anatomical, zero in the neutral standing pose.
"""

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scipy.spatial.transform import Rotation

from imocap_core.conventions import SMPL_JOINTS


@dataclass(frozen=True)
class Leg:
    """One leg in degrees. place: of the ball of the foot (contact.ContactPlace).

    flat: the sole is horizontal for any pose of the leg (`ankle` is then relative to that).
    """

    hip: float = 0.0  # flexion, thigh to the front
    knee: float = 4.0  # flexion, heel to the seat
    ankle: float = 0.0  # dorsiflexion, toes to the shin
    toes: float = 0.0  # toes up
    place: str = "front"
    flat: bool = True


@dataclass(frozen=True)
class Arms:
    """Both arms in degrees. planted: palms on the floor."""

    lift: float = -84.0  # -90 at the side, 0 to the front, 90 along the head
    open: float = 12.0  # away from the midline, 90 is straight out to the side
    elbow: float = 10.0  # forearm to the upper arm
    wrist: float = 0.0  # back of the hand to the forearm
    shrug: float = 0.0  # collar bones up
    planted: bool = False
    twist: float = 0.0  # upper arm about itself; -90: a hanging arm's elbow bends to the front
    forearm: float = 0.0  # about itself, palm from facing down to facing up


@dataclass(frozen=True)
class Key:
    """One keyframe: its time and pose.

    hips_m: height and forward position of the pelvis, corrected by contacts. right_arm: where it
    differs from the left arm, which is `arms`.
    """

    name: str
    time_s: float
    hips_m: tuple[float, float]
    lean: float  # pelvis to the front, 90 is horizontal
    back: float = 0.0  # spine rounded forward, over its three joints
    neck: float = 0.0  # chin to the chest
    left: Leg = Leg()
    right: Leg = Leg()
    arms: Arms = Arms()
    right_arm: Arms | None = None
    side_m: float = 0.0  # pelvis to the left
    turn: float = 0.0  # trunk to the left, over pelvis and spine, degrees


FORMS: dict[str, Any] = tomllib.loads(Path(__file__).with_name("poses.toml").read_text("utf-8"))
_PARTS = {"left": Leg, "right": Leg, "arms": Arms, "right_arm": Arms}


def keys_of(form: str) -> tuple[Key, ...]:
    """The keyframes of `form`: of poses.toml, where a leg or arms may have a name."""
    return tuple(_key(name, time_s) for time_s, name, *_ in FORMS[form])


def _key(name: str, time_s: float) -> Key:
    pose = FORMS["poses"][name]
    parts = {}
    for part in _PARTS.keys() & pose.keys():
        kind, given = _PARTS[part], pose[part]
        named = FORMS["legs" if kind is Leg else "arms"]
        parts[part] = kind(**(named[given] if isinstance(given, str) else given))
    return Key(name, time_s, **pose | {"hips_m": tuple(pose["hips_m"])} | parts)


SUN_SALUTATION = keys_of("yoga")


def local_rotations(key: Key) -> Rotation:
    """The 24 SMPL joint rotations of a key, parent to child, in SMPL's order (stage axes)."""
    named = _rotations(key)
    identity = Rotation.identity()
    return Rotation.concatenate([named.get(joint, identity) for joint in SMPL_JOINTS])


def _rotations(key: Key) -> dict[str, Rotation]:
    named = {
        "pelvis": _about_x(key.lean),
        "spine1": _about_x(0.30 * key.back),
        "spine2": _about_x(0.35 * key.back),
        "spine3": _about_x(0.35 * key.back),
        "neck": _about_x(0.5 * key.neck),
        "head": _about_x(0.5 * key.neck),
    }
    if key.turn:
        share = Rotation.from_euler("y", key.turn / 4, degrees=True)
        for joint in ("pelvis", "spine1", "spine2", "spine3"):
            named[joint] = share * named[joint]
    for side, leg in (("left", key.left), ("right", key.right)):
        named[f"{side}_hip"] = _about_x(-leg.hip)
        named[f"{side}_knee"] = _about_x(leg.knee)
        pitch = key.lean - leg.hip + leg.knee if leg.flat else 0.0
        named[f"{side}_ankle"] = _about_x(-leg.ankle - pitch)
        named[f"{side}_foot"] = _about_x(-leg.toes)
    named |= {f"left_{joint}": rotation for joint, rotation in _left_arm(key.arms).items()}
    right = _left_arm(key.right_arm or key.arms)
    # the same rotations on the other side of the body: reflected in x
    named |= {
        f"right_{joint}": Rotation.from_rotvec(rotation.as_rotvec() * (1.0, -1.0, -1.0))
        for joint, rotation in right.items()
    }
    return named


def _left_arm(arms: Arms) -> dict[str, Rotation]:
    """Rotations from the rest pose (left arm along +x, palm down): to the front, then lift."""
    to_front = Rotation.from_euler("y", arms.open - 90.0, degrees=True)
    shoulder = _about_x(-arms.lift) * to_front
    wrist = Rotation.from_euler("z", arms.wrist, degrees=True)
    return {
        "collar": Rotation.from_euler("z", arms.shrug, degrees=True),
        "shoulder": shoulder * _about_x(arms.twist) if arms.twist else shoulder,
        "elbow": Rotation.from_euler("y", -arms.elbow, degrees=True),
        "wrist": _about_x(arms.forearm) * wrist if arms.forearm else wrist,
    }


def _about_x(degrees: float) -> Rotation:
    return Rotation.from_euler("x", degrees, degrees=True)
