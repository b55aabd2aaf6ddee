"""Joint angles in words, and differences between performances in words and degrees."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

OF_SIDES = (
    "hip_flexion",
    "hip_adduction",
    "knee_flexion",
    "ankle_dorsiflexion",
    "shoulder_elevation",
    "elbow_flexion",
)
SHOWN = (
    *(f"{side}_{name}" for name in OF_SIDES for side in ("left", "right")),
    "trunk_flexion",
    "trunk_right_bending",
    "trunk_left_rotation",
    "pelvis_tilt",
)
"""Those that keypoints of a body determine and that have one plain meaning."""

MORE_AND_LESS = {
    "knee_flexion": ("{} more bent", "{} straighter"),
    "elbow_flexion": ("{} more bent", "{} straighter"),
    "hip_flexion": ("{} more flexed", "{} more extended"),
    "hip_adduction": ("{} further in", "{} further out to the side"),
    "ankle_dorsiflexion": ("{} more dorsiflexed", "{} more pointed"),
    "shoulder_elevation": ("raised {} higher", "raised {} less"),
    "trunk_flexion": ("bent {} further forward", "bent {} further back"),
    "trunk_right_bending": ("bent {} further to the right", "bent {} further to the left"),
    "trunk_left_rotation": ("turned {} further to the left", "turned {} further to the right"),
    "pelvis_tilt": ("tilted {} further forward", "tilted {} further back"),
}
LEAST_DEG = 5.0
LEAST_SD_DEG = 1.0  # a smaller standard deviation is no measure
WITHIN = "within the spread of their repetitions"
PLAIN = {
    "knee_flexion": "knee bend",
    "elbow_flexion": "elbow bend",
    "hip_flexion": "hip bend",
    "hip_adduction": "thigh inward",
    "ankle_dorsiflexion": "ankle bend",
    "shoulder_elevation": "arm raised",
    "trunk_flexion": "trunk bent forward",
    "trunk_right_bending": "trunk bent to the right",
    "trunk_left_rotation": "trunk turned to the left",
    "pelvis_tilt": "pelvis tilted forward",
}


@dataclass(frozen=True)
class MotionDifference:
    """One difference: a sentence, the moment of its largest value, and the angle it is about."""

    sentence: str
    phase_s: float
    angle: str | None


def in_words(name: str) -> str:
    """The name of a joint or an angle as words."""
    return name.replace("_", " ")


def without_side(name: str) -> str:
    """The name of an angle without its side."""
    return name.removeprefix("left_").removeprefix("right_")


def plain_angle(name: str) -> str:
    """An angle as a person without training in anatomy calls it."""
    plain = without_side(name)
    side = name.removesuffix(plain).replace("_", " ")
    return side + PLAIN.get(plain, in_words(plain))


def largest(
    who: str,
    other: str,
    phase_s: Float[np.ndarray, " N"],
    angles: Mapping[str, Float[np.ndarray, " N"]],
    reference: Mapping[str, Float[np.ndarray, " N"]],
    spread: Mapping[str, Float[np.ndarray, " N"]],
) -> list[MotionDifference]:
    """A sentence on every angle's largest difference of `LEAST_DEG` or more, the largest first.

    spread: standard deviations over the repetitions; differences below one come last. An angle
    without any is not compared with them.
    """
    differences = []
    for name, curve in angles.items():
        away = np.abs(curve - reference[name])
        if not np.isfinite(away).any() or np.nanmax(away) < LEAST_DEG:
            continue
        t = int(np.nanargmax(away))
        sd = float(spread[name][t]) if name in spread else float("nan")
        sentence = _sentence(who, other, name, float(phase_s[t]), curve[t], reference[name][t], sd)
        differences.append(
            (away[t] < sd, -away[t], MotionDifference(sentence, float(phase_s[t]), name))
        )
    return [difference for *_, difference in sorted(differences, key=lambda entry: entry[:2])]


def _sentence(
    who: str, other: str, name: str, phase_s: float, deg: float, against: float, sd: float
) -> str:
    word = MORE_AND_LESS[without_side(name)][0 if deg > against else 1]
    away = abs(deg - against)
    text = (
        f"{plain_angle(name)}: {who} {degrees(deg)}, {other} {degrees(against)} "
        f"({word.format(f'{away:.0f}°')}), at {phase_s:.2f} s"
    )
    if not sd >= LEAST_SD_DEG:
        return text
    return f"{text}, {away / sd:.1f} standard deviations" if away >= sd else f"{text}, {WITHIN}"


def degrees(value: float) -> str:
    """Whole degrees; a dash where there is none."""
    return f"{value:z.0f}°".replace("-", "−") if np.isfinite(value) else "–"
