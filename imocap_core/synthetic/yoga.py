"""A choreography of yoga: a sun salutation (surya namaskar) as keyframes in anatomical degrees.

Axes: y up, the origin on the floor; the performer faces +z, with +x to the left, as in the body's
rest pose. Angles are anatomical, zero in the neutral standing pose; `_rotations` converts them to
rotations of SMPL's joints.
"""

from dataclasses import dataclass

from scipy.spatial.transform import Rotation

from imocap_core.conventions import SMPL_JOINTS

DURATION_S = 6.0


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


_HANGING = Arms(lift=75, open=5, elbow=10, wrist=60, shrug=8, planted=True)
_TIPTOE = Leg(hip=2, knee=4, ankle=20, toes=55, place="back", flat=False)
_PROPPED = Arms(lift=-10, open=4, elbow=8, wrist=75, planted=True)


def _mountain(time_s: float) -> Key:
    return Key("mountain", time_s, (0.95, -0.02), lean=0)


def _sweep(time_s: float) -> Key:
    """Arms pass the horizontal at the sides, palms turned up."""
    return Key(
        "sweep", time_s, (0.95, -0.02), lean=-2, back=-4, neck=-6,
        arms=Arms(lift=45, open=82, elbow=10, shrug=4),
    )  # fmt: skip


def _overhead(time_s: float) -> Key:
    return Key(
        "overhead", time_s, (0.95, 0.04), lean=-6, back=-22, neck=-22,
        left=Leg(hip=-8), right=Leg(hip=-8),
        arms=Arms(lift=74, open=6, elbow=8, shrug=18),
    )  # fmt: skip


def _hinge(time_s: float) -> Key:
    """Half way between standing and the fold, back long, arms out to the sides."""
    leg = Leg(hip=62, knee=12)
    return Key(
        "hinge", time_s, (0.92, -0.14), lean=56, back=8, neck=-10, left=leg, right=leg,
        arms=Arms(lift=40, open=45, elbow=12, shrug=8),
    )  # fmt: skip


def _fold(time_s: float) -> Key:
    leg = Leg(hip=112, knee=14)
    return Key(
        "fold",
        time_s,
        (0.90, -0.12),
        lean=102,
        back=62,
        neck=10,
        left=leg,
        right=leg,
        arms=_HANGING,
    )


def _half_lift(time_s: float) -> Key:
    leg = Leg(hip=100, knee=8)
    return Key(
        "half lift", time_s, (0.92, -0.14), lean=92, back=-6, neck=-34, left=leg, right=leg,
        arms=Arms(lift=-8, open=2, elbow=6, wrist=10),
    )  # fmt: skip


def _lunge(time_s: float, rear: str) -> Key:
    front = Leg(hip=112, knee=92)
    back_leg = Leg(hip=-22, knee=12, ankle=25, toes=45, place="back", flat=False)
    left, right = (back_leg, front) if rear == "left" else (front, back_leg)
    return Key(
        f"lunge, {rear} leg back", time_s, (0.42, -0.42), lean=48, back=12, neck=-30,
        left=left, right=right,
        arms=Arms(lift=12, open=6, elbow=8, wrist=60, planted=True),
    )  # fmt: skip


def _plank(time_s: float) -> Key:
    return Key(
        "plank", time_s, (0.40, -0.42), lean=76, back=0, neck=-18, left=_TIPTOE, right=_TIPTOE,
        arms=_PROPPED,
    )  # fmt: skip


def _low_plank(time_s: float) -> Key:
    return Key(
        "low plank", time_s, (0.22, -0.36), lean=86, back=-4, neck=-16, left=_TIPTOE, right=_TIPTOE,
        arms=Arms(lift=-62, open=10, elbow=92, wrist=70, planted=True),
    )  # fmt: skip


def _upward_dog(time_s: float) -> Key:
    leg = Leg(hip=-16, knee=6, ankle=-42, toes=-10, place="back", flat=False)
    return Key(
        "upward dog", time_s, (0.20, -0.26), lean=58, back=-58, neck=-28, left=leg, right=leg,
        arms=Arms(lift=-42, open=4, elbow=8, wrist=70, planted=True),
    )  # fmt: skip


def _downward_dog(time_s: float) -> Key:
    leg = Leg(hip=88, knee=8, ankle=18, toes=25, place="back", flat=False)
    return Key(
        "downward dog", time_s, (0.84, -0.72), lean=128, back=4, neck=6, left=leg, right=leg,
        arms=Arms(lift=76, open=6, elbow=6, wrist=45, shrug=14, planted=True),
    )  # fmt: skip


SUN_SALUTATION: tuple[Key, ...] = (
    _mountain(0.0),
    _sweep(0.32),
    _overhead(0.72),
    _hinge(1.08),
    _fold(1.45),
    _half_lift(1.85),
    _lunge(2.3, rear="right"),
    _plank(2.75),
    _low_plank(3.1),
    _upward_dog(3.5),
    _downward_dog(4.0),
    _lunge(4.5, rear="left"),
    _fold(4.9),
    _hinge(5.2),
    _overhead(5.52),
    _sweep(5.78),
    _mountain(6.0),
)


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
    named |= {f"right_{joint}": _mirrored(r) for joint, r in right.items()}
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


def _mirrored(rotation: Rotation) -> Rotation:
    """The same rotation on the other side of the body (reflected in x)."""
    return Rotation.from_rotvec(rotation.as_rotvec() * (1.0, -1.0, -1.0))
