"""Which differences between two sets of performances exceed what chance and measurement explain.

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

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np
from jaxtyping import Float

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
