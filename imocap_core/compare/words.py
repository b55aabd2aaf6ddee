"""Differences between performances in words and degrees."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.compare.angles import Curves, TechniqueAngles
from imocap_core.compare.compare import Technique, TechniquePair

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
PARTS = {"shoulder": "arm"}  # how an angle's joint is called where its name is not the part's
LEAST_DEG = 5.0
LEAST_SD_DEG = 1.0  # a smaller standard deviation is no measure
WITHIN = "within the spread of their repetitions"
LEAST_LATE_S = 0.1
OF_TWO, OF_EACH = 8, 3  # sentences about two performers, and about each performance


@dataclass(frozen=True)
class MotionDifference:
    """One difference: a sentence, the moment of its largest value, and the angle it is about."""

    sentence: str
    phase_s: float
    angle: str | None


def markdown_list(findings: Sequence[MotionDifference]) -> list[str]:
    """The sentences as a list of a Markdown report; nothing where there are none."""
    return [*(f"* {finding.sentence}" for finding in findings), ""] if findings else []


def pair_findings(pair: TechniquePair, angles: tuple[Curves, Curves]) -> list[MotionDifference]:
    """Where the second performer's mean angles differ most from the first's.

    Differences of a standard deviation of the repetitions or more come first, then the largest.
    """
    first, second = angles
    who, other = performer_names(pair)[::-1]
    return largest(
        who,
        other,
        pair.phase_s,
        {name: curve.mean_deg for name, curve in second.items()},
        {name: curve.mean_deg for name, curve in first.items()},
        {name: np.fmax(curve.sd_deg, second[name].sd_deg) for name, curve in first.items()},
    )[:OF_TWO]


def performer_names(pair: TechniquePair) -> tuple[str, str]:
    """The names of both, told apart where they are the same."""
    first, second = pair.first.action, pair.second.action
    return (first, second) if first != second else (f"{first} (1)", f"{second} (2)")


def technique_findings(t: Technique, angles: TechniqueAngles) -> list[MotionDifference]:
    """Where each performance differs most from the mean: in its angles, then in its timing."""
    phase_s = t.instances.phase_s
    mean = {name: curve.mean_deg for name, curve in angles.mean.items()}
    differences = []
    for m, video in enumerate(t.instances.ids):
        each = {name: rows[m] for name, rows in angles.each.items()}
        differences += largest(video, "the mean", phase_s, each, mean, {})[:OF_EACH]
        differences += _timing(video, phase_s, t.lead_s[m])
    return differences


def _timing(
    video: str, phase_s: Float[np.ndarray, " N"], lead_s: Float[np.ndarray, " N"]
) -> list[MotionDifference]:
    if not np.isfinite(lead_s).any() or np.nanmax(np.abs(lead_s)) < LEAST_LATE_S:
        return []
    moment = int(np.nanargmax(np.abs(lead_s)))
    word = "later" if lead_s[moment] > 0 else "earlier"
    sentence = (
        f"{video} is {abs(lead_s[moment]):.2f} s {word} than the mean at {phase_s[moment]:.2f} s"
    )
    return [MotionDifference(sentence, float(phase_s[moment]), None)]


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
    side, _, rest = name.partition("_")
    sided = side in ("left", "right")
    plain = rest if sided else name
    joint = plain.partition("_")[0]
    part = f"{side} {PARTS.get(joint, joint)}" if sided else PARTS.get(joint, joint)
    word = MORE_AND_LESS[plain][0 if deg > against else 1]
    away = abs(deg - against)
    text = (
        f"{who}'s {part} is {word.format(f'{away:.0f}°')} than {other}'s at {phase_s:.2f} s "
        f"({_degrees(deg)} against {_degrees(against)})"
    )
    if not sd >= LEAST_SD_DEG:
        return text
    return f"{text}, {away / sd:.1f} standard deviations" if away >= sd else f"{text}, {WITHIN}"


def _degrees(value: float) -> str:
    return f"{value:z.0f}°".replace("-", "−")
