"""Parts of a technique report: differences in words, those that chance explains, and CSV tables.

Chance: a permutation test. If all performances were of one kind, any division of them into two
sets of these sizes would be as likely as the one at hand. An angle's statistic is the largest
difference of the sets' mean curves over all moments, in standard deviations of the performances
within the sets. It is held against the largest statistic of all angles under each division, which
pays for having looked at all of them at all moments (Nichols and Holmes, Human Brain Mapping 15,
2002).

Measurement: the expected error of the angles. Videos that are solved together share their errors,
so a set's mean is not more exact than one of its performances.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import comb
from pathlib import Path

import numpy as np
from jaxtyping import Float

from imocap_core.compare.compare import (
    Curves,
    Technique,
    TechniqueAngles,
    TechniquePair,
    expected_error_deg,
)
from imocap_core.files import write_csv
from imocap_core.motion.multiview.modes import LEAST_PERFORMANCES, Modes
from imocap_core.technique import SD_APART, MotionDifference, in_words, largest
from imocap_core.variation import Variation

_LEAST_LATE_S = 0.1
_OF_TWO, _OF_EACH = 8, 3  # sentences about two performers, and about each performance


def pair_findings(
    pair: TechniquePair, angles: tuple[TechniqueAngles, TechniqueAngles], chance: Chance
) -> list[MotionDifference]:
    """Where the second performer's mean angles differ most from the first's.

    Differences that neither chance nor the expected errors explain come first (with too few
    performances: those of a standard deviation of the repetitions or more), then the largest.
    """
    first, second = (of.mean for of in angles)
    who, other = performer_names(pair)[::-1]
    return largest(
        who,
        other,
        pair.phase_s,
        {name: curve.mean_deg for name, curve in second.items()},
        {name: curve.mean_deg for name, curve in first.items()},
        {name: np.fmax(curve.sd_deg, second[name].sd_deg) for name, curve in first.items()},
        _judged(pair, first, second, chance) if chance.telling else {},
    )[:_OF_TWO]


def _judged(
    pair: TechniquePair, first: Curves, second: Curves, chance: Chance
) -> dict[str, tuple[bool, str]]:
    """Of each angle, whether chance or the expected error explains its difference, in words."""
    errors, words = expected_error_deg(pair), {}
    for name, p in chance.p.items():
        away = np.abs(second[name].mean_deg - first[name].mean_deg)
        t = int(np.nanargmax(away))
        error = float(errors[name][t]) if name in errors else 0.0
        if p > LIKELY:
            words[name] = True, f", which chance explains (p = {p:.2f})"
        elif away[t] < SD_APART * error:
            words[name] = True, f", within twice the expected error (± {error:.0f}°)"
        else:
            words[name] = False, f", more than chance explains (p = {p:.2g})"
    return words


def chance_sentence(pair: TechniquePair, chance: Chance) -> str:
    """What p means, or that there are too few performances to tell differences from chance."""
    if chance.telling:
        return (
            "p: how often chance gives any angle, at any moment, so large a difference "
            "(permutation test)."
        )
    ours, theirs = (len(t.instances.ids) for t in (pair.first, pair.second))
    return (
        f"{ours} and {theirs} performances are too few to tell differences from chance; 4 and 4 "
        "are enough."
    )


def performer_names(pair: TechniquePair) -> tuple[str, str]:
    """The names of both, told apart where they are the same."""
    first, second = pair.first.action, pair.second.action
    return (first, second) if first != second else (f"{first} (1)", f"{second} (2)")


def technique_findings(t: Technique, angles: TechniqueAngles) -> list[MotionDifference]:
    """Where each performance differs most from the mean: in its angles, then in its timing.

    Of two performances, where the second differs from the first: nobody performed their mean.
    """
    phase_s = t.instances.phase_s
    if len(t.instances.ids) == 2:
        first, second = t.instances.ids
        one, two = ({name: rows[m] for name, rows in angles.each.items()} for m in (0, 1))
        later_s = t.lead_s[1] - t.lead_s[0]
        return [
            *largest(second, first, phase_s, two, one, {})[:_OF_TWO],
            *_timing(second, first, phase_s, later_s),
        ]
    mean = {name: curve.mean_deg for name, curve in angles.mean.items()}
    differences = []
    for m, video in enumerate(t.instances.ids):
        each = {name: rows[m] for name, rows in angles.each.items()}
        differences += largest(video, "the mean", phase_s, each, mean, {})[:_OF_EACH]
        differences += _timing(video, "the mean", phase_s, t.lead_s[m])
    return differences


def _timing(
    video: str, other: str, phase_s: Float[np.ndarray, " N"], lead_s: Float[np.ndarray, " N"]
) -> list[MotionDifference]:
    if not np.isfinite(lead_s).any() or np.nanmax(np.abs(lead_s)) < _LEAST_LATE_S:
        return []
    moment = int(np.nanargmax(np.abs(lead_s)))
    word = "later" if lead_s[moment] > 0 else "earlier"
    sentence = (
        f"{video} is {abs(lead_s[moment]):.2f} s {word} than {other} at {phase_s[moment]:.2f} s"
    )
    return [MotionDifference(sentence, float(phase_s[moment]), None)]


def number(value: float, decimals: int = 1) -> str:
    """A number for a table; a dash where it is unknown."""
    return f"{value:.{decimals}f}" if np.isfinite(value) else "–"


def moment_sentences(
    phase_s: Float[np.ndarray, " N"],
    values: Float[np.ndarray, "N J"],
    names: Sequence[str],
    unit: str,
) -> list[str]:
    """Where a spread or a difference (N, J) is largest: three joints, and when."""
    peak = np.nanmax(np.where(np.isfinite(values), values, -np.inf), axis=0)
    order = [j for j in np.argsort(-peak)[:3] if np.isfinite(peak[j])]
    return [
        f"{in_words(names[j])} {number(float(peak[j]))} {unit} at "
        f"{phase_s[int(np.nanargmax(values[:, j]))]:.2f} s"
        for j in order
    ]


def mode_sentences(modes: Modes, names: Sequence[str], count: int = 3) -> list[str]:
    """The largest ways to differ: their shares of all deviations, and the joints that turn most."""
    return [
        f"Mode {k + 1}, {100 * share:.0f} % of the deviations: "
        + ", ".join(f"{in_words(names[j])} {number(deg[j])}°" for j in np.argsort(-deg)[:4])
        for k, (share, deg) in enumerate(zip(modes.share[:count], modes.of_joints(), strict=False))
    ]


def modes_known(variation: Variation) -> str:
    """How many modes hold for further performances, and by how much."""
    performances, errors = len(variation.ids), variation.held_out
    if len(errors) == 1:
        return (
            f"Whether {performances} performances differ in ways that others of the action share "
            f"cannot be known; {LEAST_PERFORMANCES} are enough."
        )
    count = len(variation.modes.share)
    if count == 0:
        return "No mode predicts a performance that it was not learned from: they differ singly."
    which = "The first holds" if count == 1 else f"The first {count} hold"
    return (
        f"{which} for further performances: of one left out, {100 * (1 - errors[count]):.0f} % of "
        "the deviation of half its joints and moments is predicted from the other half."
    )


def write_course(
    file: Path,
    phase_s: Float[np.ndarray, " N"],
    names: Sequence[str],
    columns: dict[str, Float[np.ndarray, "N J"]],
) -> None:
    """One row per moment and joint: `columns` (N, J) by name, empty where unknown."""
    rows = [
        [f"{phase:.4f}", name, *(_cell(c[t, j]) for c in columns.values())]
        for t, phase in enumerate(phase_s)
        for j, name in enumerate(names)
    ]
    write_csv(file, ["phase_s", "joint", *columns], rows)


def write_performances(
    file: Path, ids: Sequence[str], columns: dict[str, Float[np.ndarray, " M"]]
) -> None:
    """One row per performance: `columns` (M,) by name."""
    rows = [[video, *(_cell(c[m]) for c in columns.values())] for m, video in enumerate(ids)]
    write_csv(file, ["video", *columns], rows)


def _cell(value: float) -> str:
    return f"{value:.4f}" if np.isfinite(value) else ""


MOST_DIVISIONS = 2000  # all of two sets of six; of larger sets as many at random
LEAST_SD_DEG = 1.0  # of the performances within the sets: a smaller one is no measure
LIKELY = 0.05  # at this probability, or below it, a difference is more than chance explains

Each = Mapping[str, Float[np.ndarray, "_M N"]]


@dataclass(frozen=True)
class Chance:
    """How well chance explains the differences of two sets.

    Attributes:
        p: of each angle, the probability of so large a difference of any angle.
        least: the lowest that sets of these sizes can reach.
    """

    p: dict[str, float]
    least: float

    @property
    def telling(self) -> bool:
        """Whether there are enough performances to tell anything from chance."""
        return self.least <= LIKELY


def chance_of(first: Each, second: Each, rng: np.random.Generator) -> Chance:
    """The permutation test of two sets of performances on one axis.

    Args:
        first, second: degrees of each angle, (M, N) for M performances at N moments; moments that
            one of them does not show (NaN) do not count.
    """
    x = np.stack([np.concatenate([first[name], second[name]]) for name in first], axis=-1)
    x = x[:, np.isfinite(x).all(axis=(0, 2))]
    ours, theirs = (len(next(iter(of.values()))) for of in (first, second))
    alike = 1 + (ours == theirs)  # exchanging the sets changes nothing
    least = alike / comb(ours + theirs, ours)
    if min(ours, theirs) == 0 or ours + theirs < 3 or not x.size:
        return Chance(dict.fromkeys(first, 1.0), 1.0)
    statistic = _statistics(x, _divisions(ours, theirs, rng))
    reached = statistic.max(axis=1, keepdims=True) >= statistic[0] - 1e-9
    p = reached.mean(axis=0).tolist()
    return Chance(dict(zip(first, p, strict=True)), least)


def _divisions(ours: int, theirs: int, rng: np.random.Generator) -> Float[np.ndarray, "L M"]:
    """1 where a performance is in the first set; the division at hand first."""
    count = ours + theirs
    if comb(count, ours) <= MOST_DIVISIONS:
        rows = np.array([*combinations(range(count), ours)])
    else:
        drawn = [rng.permutation(count)[:ours] for _ in range(MOST_DIVISIONS - 1)]
        rows = np.array([np.arange(ours), *drawn])
    of_first = np.zeros((len(rows), count))
    np.put_along_axis(of_first, rows, 1.0, axis=1)
    return of_first


def _statistics(
    x: Float[np.ndarray, "M N A"], of_first: Float[np.ndarray, "L M"]
) -> Float[np.ndarray, "L A"]:
    """Largest difference of the sets' means, in standard deviations within the sets."""
    count, (M, N, A) = of_first.sum(axis=1)[:, None], x.shape
    x = x - x.mean(axis=0)
    total = of_first @ x.reshape(M, N * A)  # of the second set: the opposite
    between = total**2 / count + total**2 / (M - count)
    within = (x**2).sum(axis=(0, 1)) - between.reshape(-1, N, A).sum(axis=1)
    sd = np.sqrt(np.maximum(within, 0.0) / (N * (M - 2)) + LEAST_SD_DEG**2)
    apart = np.abs(total) * (1 / count + 1 / (M - count))
    return np.asarray(apart.reshape(-1, N, A).max(axis=1) / sd)
