"""Technique: what the performances of one action share, and how they differ (docs/technique.md).

Consistency of repetitions: the coefficient of multiple correlation of gait analysis, squared. 1
when all performances are equal, 0 when they are no more alike than unrelated moments of them.

Joint angles in words, and differences between performances in words and degrees.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from imocap_core.rotations import geodesic_angle, log, mean

ROUNDS = 3  # alternations of mean and headings; the first nearly converges


@dataclass(frozen=True, eq=False)
class AlignedPerformances:
    """M performances at N moments; the world's y points up.

    Attributes:
        ids: names of the performances.
        joint_names: the pelvis first.
        phase_s: the moments.
        R_local: rotations against the parent; joint 0 world from body.
        joints: metres from the pelvis, of one and the same body for all.
        inside: whether the performance shows that moment.
    """

    ids: tuple[str, ...]
    joint_names: tuple[str, ...]
    phase_s: Float[np.ndarray, " N"]
    R_local: Float[np.ndarray, "M N J 3 3"]
    joints: Float[np.ndarray, "M N J 3"]
    inside: Bool[np.ndarray, "M N"]

    @property
    def shown(self) -> Int[np.ndarray, " N"]:
        """How many performances show each moment."""
        return self.inside.sum(0)


def at_moments(
    performances: AlignedPerformances, chosen: Bool[np.ndarray, " N"]
) -> AlignedPerformances:
    """The same at the chosen moments."""
    return replace(
        performances,
        phase_s=performances.phase_s[chosen],
        R_local=performances.R_local[:, chosen],
        joints=performances.joints[:, chosen],
        inside=performances.inside[:, chosen],
    )


def facing_alike(performances: AlignedPerformances) -> AlignedPerformances:
    """Each performance turned about the vertical by one angle for all moments, onto the mean.

    The facing direction is no technique; how a performance turns in its course is preserved.
    """
    joints, weight = performances.joints, performances.inside.astype(np.float64)
    headings = np.zeros(len(performances.ids))
    for _ in range(ROUNDS):
        turned = np.einsum("mab,mnjb->mnja", _about_y(headings), joints)
        mean = mean_over(turned, weight)
        headings = headings + np.array(
            [heading(x, mean, w) for x, w in zip(turned, weight, strict=True)]
        )
    return turned_by(performances, headings)


def to_the_front(performances: AlignedPerformances) -> AlignedPerformances:
    """All performances turned about the vertical by one angle, to face +z on average.

    By the pelvis's axis to the left, which stays level in a forward bend.
    """
    left = (performances.inside[..., None] * performances.R_local[:, :, 0, :, 0]).sum((0, 1))
    angle = float(np.arctan2(left[2], left[0]))
    return turned_by(performances, np.full(len(performances.ids), angle))


def turned_by(
    performances: AlignedPerformances, headings: Float[np.ndarray, " M"]
) -> AlignedPerformances:
    """Every performance turned about the vertical by its angle, radians."""
    turns = _about_y(headings)
    R_local = performances.R_local.copy()
    R_local[:, :, 0] = turns[:, None] @ performances.R_local[:, :, 0]
    joints = np.einsum("mab,mnjb->mnja", turns, performances.joints)
    return replace(performances, R_local=R_local, joints=joints)


def heading(
    joints: Float[np.ndarray, "N J 3"],
    onto: Float[np.ndarray, "N J 3"],
    weight: Float[np.ndarray, " N"],
) -> float:
    """The angle about y, radians, that best aligns joints with others (least squares)."""
    w = weight[:, None]
    along = (w * (joints[..., 0] * onto[..., 0] + joints[..., 2] * onto[..., 2])).sum()
    aside = (w * (joints[..., 2] * onto[..., 0] - joints[..., 0] * onto[..., 2])).sum()
    return float(np.arctan2(aside, along))


def mean_over(
    values: Float[np.ndarray, "M N *rest"], weight: Float[np.ndarray, "M N"]
) -> Float[np.ndarray, "N *rest"]:
    """Weighted mean over the first axis; 0 where all weights are 0."""
    share = weight / np.maximum(weight.sum(0), 1e-12)
    return np.einsum("mn,mn...->n...", share, values)


def _about_y(angles: np.ndarray) -> np.ndarray:
    """Rotations (M, 3, 3) about the vertical by angles (M,), radians."""
    return Rotation.from_euler("y", angles[:, None]).as_matrix().reshape(-1, 3, 3)


@dataclass(frozen=True, eq=False)
class MeanMotion:
    """The mean of M performances at N moments, and the deviations from it.

    Attributes:
        R_local: chordal mean of every joint's rotation.
        joints: mean position from the pelvis, metres.
        turns: rotation vectors from the mean to each performance, in the joint's own axes, radians;
            0 where a performance does not show the moment.
        shifts: from the mean position to each performance's, metres; 0 likewise.
    """

    R_local: Float[np.ndarray, "N J 3 3"]
    joints: Float[np.ndarray, "N J 3"]
    turns: Float[np.ndarray, "M N J 3"]
    shifts: Float[np.ndarray, "M N J 3"]


def mean_motion(performances: AlignedPerformances) -> MeanMotion:
    """Mean over the performances that show a moment."""
    R = torch.as_tensor(performances.R_local)
    weight = performances.inside.astype(np.float64)
    mean_R = mean(R, torch.as_tensor(weight)[..., None])
    joints = mean_over(performances.joints, weight)
    shown = weight[..., None, None]
    turns = log(mean_R.transpose(-1, -2) @ R).numpy() * shown
    return MeanMotion(mean_R.numpy(), joints, turns, (performances.joints - joints) * shown)


def spread(
    deviations: Float[np.ndarray, "M N J 3"], inside: Bool[np.ndarray, "M N"]
) -> Float[np.ndarray, "N J"]:
    """Standard deviation over the performances, from their deviations from the mean.

    With n - 1 degrees of freedom; NaN where fewer than two performances show the moment.
    """
    squares = (deviations**2).sum(-1) * inside[..., None]
    free = inside.sum(0) - 1.0
    safe = np.where(free > 0, free, 1.0)[:, None]
    return np.where(free[:, None] > 0, np.sqrt(squares.sum(0) / safe), np.nan)


def consistency(positions: Float[np.ndarray, "M N J 3"], inside: Bool[np.ndarray, "M N"]) -> float:
    """Adjusted coefficient of determination of the moment, for all joints together.

    ``1 - [sum (x - mean_t)^2 / sum (n_t - 1)] / [sum (x - mean)^2 / (sum n_t - 1)]``, sums over the
    moments t that at least two performances show and over the n_t performances that do; what
    Kadaba et al. (J. Orthop. Res. 1989) call the squared adjusted coefficient of multiple
    correlation, for positions in space. Below 0 counts as 0.

    Args:
        positions: of the joints, any unit.
        inside: whether a performance shows a moment.

    Raises:
        ValueError: no moment is shown by two performances.
    """
    inside = inside & (inside.sum(0) >= 2)
    count = inside.sum(0)
    if not count.any():
        raise ValueError("inside: expected a moment that two performances show, got none")
    weight = inside[..., None, None].astype(np.float64)
    mean_of_moment = (weight * positions).sum(0) / np.maximum(count, 1)[:, None, None]
    mean_of_all = (weight * positions).sum((0, 1)) / count.sum()
    degrees_of_freedom = (count - 1)[count > 0].sum()
    within = float((weight * (positions - mean_of_moment) ** 2).sum()) / degrees_of_freedom
    total = float((weight * (positions - mean_of_all) ** 2).sum()) / (count.sum() - 1)
    return float(max(1.0 - within / total, 0.0)) if total > 0 else float("nan")


LEAST_M = 1e-3  # a spread below it counts as this much


@dataclass(frozen=True, eq=False)
class Difference:
    """Difference of two mean motions at N moments.

    Attributes:
        angle_deg: between the joints' rotations.
        distance_mm: between their positions from the pelvis.
        ratio: of that distance to the repetitions' own spread.
    """

    angle_deg: Float[np.ndarray, "N J"]
    distance_mm: Float[np.ndarray, "N J"]
    ratio: Float[np.ndarray, "N J"]


def difference(
    R_first: Float[np.ndarray, "N J 3 3"],
    R_second: Float[np.ndarray, "N J 3 3"],
    positions_first: Float[np.ndarray, "N J 3"],
    positions_second: Float[np.ndarray, "N J 3"],
    spread_first: Float[np.ndarray, "N J"],
    spread_second: Float[np.ndarray, "N J"],
) -> Difference:
    """Compare the mean motions of two performers, facing one way, on one body.

    Positions and spreads in metres. spread_*: standard deviation of each performer's repetitions,
    NaN where unknown. The ratio is to the root mean square of the two (of one, where the other is
    unknown), at least 1 mm; NaN where both are unknown.
    """
    angle = geodesic_angle(torch.as_tensor(R_first), torch.as_tensor(R_second)).numpy()
    distance = np.linalg.norm(positions_second - positions_first, axis=-1)
    squares = np.stack([spread_first, spread_second]) ** 2
    valid = np.isfinite(squares)
    count = valid.sum(0)
    pooled = np.sqrt(np.where(valid, squares, 0.0).sum(0) / np.maximum(count, 1))
    ratio = np.where(count > 0, distance / np.maximum(pooled, LEAST_M), np.nan)
    return Difference(np.rad2deg(angle), 1000 * distance, ratio)


# a joint angle -> in plain words, and of a body with more and with less of it
_WORDS = {
    "hip_flexion": ("hip bend", "{} more flexed", "{} more extended"),
    "hip_adduction": ("thigh inward", "{} further in", "{} further out to the side"),
    "knee_flexion": ("knee bend", "{} more bent", "{} straighter"),
    "ankle_dorsiflexion": ("foot pulled up", "{} more pulled up", "{} more pointed"),
    "shoulder_elevation": ("arm raised", "raised {} higher", "raised {} less"),
    "elbow_flexion": ("elbow bend", "{} more bent", "{} straighter"),
}
_TRUNK_WORDS = {
    "trunk_flexion": ("trunk bent forward", "bent {} further forward", "bent {} further back"),
    "trunk_right_bending": (
        "trunk bent to the right",
        "bent {} further to the right",
        "bent {} further to the left",
    ),
    "trunk_left_rotation": (
        "trunk turned to the left",
        "turned {} further to the left",
        "turned {} further to the right",
    ),
    "pelvis_tilt": ("pelvis tilted forward", "tilted {} further forward", "tilted {} further back"),
}
SHOWN = (*(f"{side}_{name}" for name in _WORDS for side in ("left", "right")), *_TRUNK_WORDS)
"""Those that keypoints of a body determine and that have one plain meaning."""

SD_APART = 2.0  # expected errors by which angles differ for sure
_LEAST_DEG = 5.0
_LEAST_SD_DEG = 1.0  # a smaller standard deviation is no measure
_WITHIN = "within the spread of their repetitions"


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
    return side + (_WORDS | _TRUNK_WORDS)[plain][0]


def largest(
    who: str,
    other: str,
    phase_s: Float[np.ndarray, " N"],
    angles: Mapping[str, Float[np.ndarray, " N"]],
    reference: Mapping[str, Float[np.ndarray, " N"]],
    spread: Mapping[str, Float[np.ndarray, " N"]],
    judged: Mapping[str, tuple[bool, str]] = {},
) -> list[MotionDifference]:
    """A sentence on every angle's largest difference of `_LEAST_DEG` or more, the largest first.

    spread: standard deviations over the repetitions; differences below one come last. An angle
    without any is not compared with them. judged: of an angle, whether its difference comes last,
    and why, in place of its spread.
    """
    differences = []
    for name, curve in angles.items():
        away = np.abs(curve - reference[name])
        if not np.isfinite(away).any() or np.nanmax(away) < _LEAST_DEG:
            continue
        t = int(np.nanargmax(away))
        sd = float(spread[name][t]) if name in spread else float("nan")
        last, why = judged.get(name) or _by_spread(float(away[t]), sd)
        sentence = _sentence(who, other, name, float(phase_s[t]), curve[t], reference[name][t])
        difference = MotionDifference(sentence + why, float(phase_s[t]), name)
        differences.append((last, -away[t], difference))
    return [difference for *_, difference in sorted(differences, key=lambda entry: entry[:2])]


def _sentence(who: str, other: str, name: str, phase_s: float, deg: float, against: float) -> str:
    word = (_WORDS | _TRUNK_WORDS)[without_side(name)][1 if deg > against else 2]
    return (
        f"{plain_angle(name)}: {who} {degrees(deg)}, {other} {degrees(against)} "
        f"({word.format(f'{abs(deg - against):.0f}°')}), at {phase_s:.2f} s"
    )


def _by_spread(away: float, sd: float) -> tuple[bool, str]:
    if not sd >= _LEAST_SD_DEG:
        return away < sd, ""
    return away < sd, f", {away / sd:.1f} standard deviations" if away >= sd else f", {_WITHIN}"


def degrees(value: float) -> str:
    """Whole degrees; a dash where there is none."""
    return f"{value:z.0f}°".replace("-", "−") if np.isfinite(value) else "–"
