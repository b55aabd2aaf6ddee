"""A choreography of tai chi: a short form as keyframed poses and hands, in anatomical degrees.

Commencing, parting the horse's mane, brush knee, cloud hands to both sides, cross hands, closing.
The stance is narrow, wide or one foot before the other, and the weight shifts over the feet.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from imocap_core.synthetic.yoga import Arms, Key, Leg

DURATION_S = 8.0

_NARROW = Leg(hip=4, knee=10)
_WIDE = Leg(hip=20, knee=40, place="wide")
_AHEAD = Leg(hip=42, knee=50, place="forward")
_BEHIND = Leg(hip=-4, knee=22, place="front")
_HANGING = Arms(lift=-80, open=16, elbow=16, twist=-70)
_BALL_ABOVE = Arms(lift=-8, open=30, elbow=92, twist=-15, shrug=3)
_BALL_BELOW = Arms(lift=-58, open=14, elbow=72, twist=-55, forearm=70)
_GUARD = Arms(lift=-62, open=24, elbow=42, twist=-75, wrist=30)
_BEFORE_FACE = Arms(lift=14, open=28, elbow=78, twist=-40, forearm=25, shrug=4)
_BEFORE_BELLY = Arms(lift=-50, open=12, elbow=66, twist=-50, forearm=35)

TAI_CHI: tuple[Key, ...] = (
    Key("standing", 0.0, (0.93, -0.02), lean=0, left=_NARROW, right=_NARROW, arms=_HANGING),
    Key("opening step", 0.7, (0.89, -0.02), lean=0, left=_WIDE, right=_NARROW, arms=_HANGING,
        side_m=-0.01),
    Key("arms rise", 1.4, (0.88, -0.02), lean=0, left=_WIDE, right=_NARROW,
        arms=Arms(lift=-2, open=8, elbow=24, twist=-40, wrist=-28, shrug=4), side_m=0.06),
    Key("arms sink", 2.1, (0.82, -0.03), lean=4, left=_WIDE, right=_NARROW,
        arms=Arms(lift=-58, open=10, elbow=66, twist=-75, wrist=38), side_m=0.06),
    Key("holding the ball", 2.8, (0.82, -0.03), lean=4, left=_WIDE, right=_NARROW,
        arms=_BALL_BELOW, right_arm=_BALL_ABOVE, side_m=-0.04, turn=-14),
    Key("parting the mane", 3.6, (0.82, 0.16), lean=5, left=_AHEAD, right=_BEHIND,
        arms=Arms(lift=2, open=16, elbow=38, twist=-55, forearm=55), right_arm=_GUARD,
        side_m=0.03, turn=12),
    Key("brushing the knee", 4.4, (0.82, 0.14), lean=6, left=_AHEAD, right=_BEHIND,
        arms=_GUARD, right_arm=Arms(lift=-4, open=6, elbow=30, twist=-65, wrist=52),
        side_m=0.03, turn=8),
    Key("cloud hands, left", 5.2, (0.83, -0.02), lean=2, left=_WIDE, right=_NARROW,
        arms=_BEFORE_FACE, right_arm=_BEFORE_BELLY, side_m=0.10, turn=22),
    Key("cloud hands, right", 6.0, (0.83, -0.02), lean=2, left=_WIDE, right=_NARROW,
        arms=_BEFORE_BELLY, right_arm=_BEFORE_FACE, side_m=-0.01, turn=-22),
    Key("crossing hands", 6.7, (0.86, -0.02), lean=0, left=_WIDE, right=_NARROW,
        arms=Arms(lift=-12, open=14, elbow=80, twist=-30, forearm=30), side_m=0.04),
    Key("closing step", 7.4, (0.91, -0.02), lean=0, left=_NARROW, right=_NARROW,
        arms=Arms(lift=-52, open=12, elbow=40, twist=-70, wrist=22)),
    Key("standing again", 8.0, (0.93, -0.02), lean=0, left=_NARROW, right=_NARROW, arms=_HANGING),
)  # fmt: skip

# left and right hand at each key
HANDS: tuple[tuple[str, str], ...] = (
    ("relaxed", "relaxed"),
    ("relaxed", "relaxed"),
    ("relaxed", "relaxed"),
    ("open", "open"),
    ("round", "round"),
    ("open", "point"),
    ("fist", "open"),
    ("round", "point"),
    ("point", "round"),
    ("fist", "fist"),
    ("open", "open"),
    ("relaxed", "relaxed"),
)


def _finger(bend1: float, bend2: float, bend3: float, spread: float = 0.0) -> tuple[float, ...]:
    return (bend1, spread, bend2, bend3)


def _hand(*fingers: tuple[float, ...]) -> Float[np.ndarray, "21"]:
    """Degrees from the rest pose: index, middle, little and ring finger, thumb."""
    return np.array([angle for finger in fingers for angle in finger])


# the thumb: bend, spread and twist of its root, then its two bends
HAND_POSES: dict[str, Float[np.ndarray, "21"]] = {
    "relaxed": _hand(
        _finger(8, 12, 6), _finger(12, 14, 8), _finger(18, 18, 10), _finger(15, 16, 9),
        (4, 0, 0, 6, 8),
    ),
    "open": _hand(
        _finger(-14, -10, -8, 5), _finger(-14, -10, -8), _finger(-12, -10, -8, -9),
        _finger(-14, -10, -8, -4), (-12, 8, 0, -4, -8),
    ),
    "round": _hand(
        _finger(16, 24, 14, 4), _finger(18, 26, 14), _finger(20, 26, 14, -6),
        _finger(19, 26, 14, -3), (0, 14, 4, 8, 10),
    ),
    "point": _hand(
        _finger(-8, -8, -6), _finger(-8, -8, -6, -2), _finger(58, 74, 44), _finger(56, 76, 44),
        (26, 6, 8, 34, 40),
    ),
    "fist": _hand(
        _finger(56, 78, 46), _finger(60, 80, 46), _finger(60, 76, 44), _finger(60, 80, 46),
        (24, -4, 6, 38, 44),
    ),
}  # fmt: skip
