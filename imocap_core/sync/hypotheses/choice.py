"""Joint choice of one hypothesis for each video: the labelling of least energy, exactly.

Every video has a cost of each of its hypotheses by itself, every pair of videos one of each pair of
theirs. Labellings are extended video by video; those that cannot come near a solution in hand,
whatever the remaining videos contribute, are dropped (branch and bound).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

MOST_PARTIAL = 200_000  # labellings at once; beyond it the cheapest, and the choice is approximate


@dataclass(frozen=True)
class Labelling:
    """One hypothesis of each video, and the energy; videos in their order."""

    labels: tuple[int, ...]
    energy: float


def best_labellings(
    unary: Sequence[Float[np.ndarray, " _"]],
    pairs: Mapping[tuple[int, int], Float[np.ndarray, "_ _"]],
    *,
    margin: float,
) -> list[Labelling]:
    """The labelling of least energy, then all whose energy is less than ``margin`` above it.

    Args:
        unary: per video, of each hypothesis; pairs: per (u, v) with u < v, of each pair.
    """
    count = len(unary)
    limit = _descended(unary, pairs).energy + margin
    labels, energy = np.zeros((1, 0), dtype=int), np.zeros(1)
    for v in range(count):
        step = _conditional(v, unary, pairs, labels)
        options = np.arange(step.shape[1])
        labels = np.concatenate(
            [np.repeat(labels, len(options), axis=0), np.tile(options, len(labels))[:, None]],
            axis=1,
        )
        energy = (energy[:, None] + step).ravel()
        bound = energy + _remaining(v + 1, unary, pairs, labels)
        order = np.argsort(bound, kind="stable")[:MOST_PARTIAL]
        order = order[bound[order] <= limit + 1e-9]
        labels, energy = labels[order], energy[order]
    order = np.argsort(energy, kind="stable")
    near = [k for k in order if energy[k] <= energy[order[0]] + margin]
    return [Labelling(tuple(int(x) for x in labels[k]), float(energy[k])) for k in near]


def energy_of(
    labels: Sequence[int],
    unary: Sequence[Float[np.ndarray, " _"]],
    pairs: Mapping[tuple[int, int], Float[np.ndarray, "_ _"]],
) -> float:
    """Sum of the costs of single videos and of pairs."""
    single = sum(float(cost[label]) for cost, label in zip(unary, labels, strict=True))
    return single + sum(float(cost[labels[u], labels[v]]) for (u, v), cost in pairs.items())


def _descended(
    unary: Sequence[np.ndarray], pairs: Mapping[tuple[int, int], np.ndarray]
) -> Labelling:
    """A local minimum: from the first hypotheses, one video at a time while that helps."""
    labels = [0] * len(unary)
    best = energy_of(labels, unary, pairs)
    while True:
        changes = [
            (energy_of([*labels[:v], k, *labels[v + 1 :]], unary, pairs), v, k)
            for v in range(len(unary))
            for k in range(len(unary[v]))
        ]
        energy, v, k = min(changes)
        if energy >= best:
            return Labelling(tuple(labels), best)
        labels[v], best = k, energy


def _conditional(
    v: int,
    unary: Sequence[np.ndarray],
    pairs: Mapping[tuple[int, int], np.ndarray],
    labels: Int[np.ndarray, "n k"],
) -> Float[np.ndarray, "n K_v"]:
    """What each hypothesis of video v adds to labellings of the first k videos (k <= v)."""
    added = np.tile(unary[v], (len(labels), 1))
    for u in range(labels.shape[1]):
        added = added + pairs[u, v][labels[:, u]]
    return added


def _remaining(
    begin: int,
    unary: Sequence[np.ndarray],
    pairs: Mapping[tuple[int, int], np.ndarray],
    labels: Int[np.ndarray, "n k"],
) -> Float[np.ndarray, " n"]:
    """The least that videos from ``begin`` on can add to labellings of those before."""
    count = len(unary)
    bound = np.zeros(len(labels))
    for v in range(begin, count):
        bound = bound + _conditional(v, unary, pairs, labels).min(axis=1)
        bound = bound + sum(float(pairs[u, v].min()) for u in range(begin, v))
    return bound
