"""Mirrored videos: the picture was flipped, or the performer has the other hand.

The mirror image of a pose has its joints reflected and left and right swapped. For each pair of
videos the warp residuals with and without reflection are compared; which videos are mirrored is
then a question of signs, s_i s_j = -1 where reflection fits better. The signs that agree with most
of the evidence are found together, and the smaller side is the mirrored one.

A walk is its own mirror image half a cycle later, and two walks that begin with different feet look
mirrored. So the comparison is made of poses and of motion, and of each in the order of time as it
is, with the videos begun wherever they fit best, and then of the frames that fit best. Of these six
the weakest counts where all agree. A movement that is its own mirror image has no evidence either
way, and no video of it is called mirrored.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

# By how much (natural logarithm of the residual) reflection must fit better. Training clips that
# are not mirrored stay below 0.03. A video is flipped on clearer evidence than it is reported on: a
# wrong flip costs more than a missed one.
LEAST_MARGIN, CLEAR_MARGIN = 0.07, 0.2
SWEEPS = 20


def mirrored_poses(
    poses: Float[np.ndarray, "T J 3"], twins: Sequence[int]
) -> Float[np.ndarray, "T J 3"]:
    """The mirror image of poses: x -> -x, and joint j becomes its twin `twins[j]`."""
    reflected: np.ndarray = poses[:, list(twins)] * np.array([-1.0, 1.0, 1.0])
    return reflected


def mirror_evidence(
    plain: Float[np.ndarray, "M M"], reflected: Float[np.ndarray, "M M"]
) -> Float[np.ndarray, "M M"]:
    """How much better a pair fits without reflection, symmetric, 0 where unknown.

    log(residual with reflection / residual without), averaged over both directions.
    """
    with_, without = 0.5 * (reflected + reflected.T), 0.5 * (plain + plain.T)
    ratio = np.maximum(with_, 1e-12) / np.maximum(without, 1e-12)
    return np.asarray(np.nan_to_num(np.log(ratio), nan=0.0))


def agreed(kinds: Sequence[Float[np.ndarray, "M M"]]) -> Float[np.ndarray, "M M"]:
    """The weakest of several kinds of evidence where all have the same sign; else 0."""
    every = np.stack(kinds)
    same = np.abs(np.sign(every).sum(axis=0)) == len(every)
    weakest = np.sign(every[0]) * np.abs(every).min(axis=0)
    return np.where(same, weakest, 0.0)


def signs_of(
    evidence: Float[np.ndarray, "M M"], pinned: Sequence[bool] | Bool[np.ndarray, " M"]
) -> Int[np.ndarray, " M"]:
    """Signs of +1 and -1 that maximise the sum over pairs of s_i s_j evidence_ij.

    Videos that are `pinned` keep +1. Without any, the larger side is +1; of equal sides the one
    with the first video.
    """
    fixed = np.asarray(pinned, dtype=bool)
    M = len(evidence)
    leading = np.linalg.eigh(evidence)[1][:, -1]
    starts = [np.ones(M, dtype=np.int64), np.where(leading >= 0, 1, -1)]
    best, best_value = starts[0], -np.inf
    for start in starts:
        signs = np.where(fixed, 1, start)
        for _ in range(SWEEPS):
            before = signs.copy()
            for v in np.flatnonzero(~fixed):
                pull = evidence[v] @ signs - evidence[v, v] * signs[v]
                signs[v] = signs[v] if pull == 0 else np.sign(pull)
            if (signs == before).all():
                break
        value = float(signs @ evidence @ signs)
        if value > best_value + 1e-12:
            best, best_value = signs, value
    if not fixed.any():
        total = int(best.sum())
        best = -best if total < 0 or (total == 0 and best[0] < 0) else best
    return best


def mirror_margins(
    evidence: Float[np.ndarray, "M M"], signs: Int[np.ndarray, " M"]
) -> Float[np.ndarray, " M"]:
    """Per video: how much better it fits the others reflected, the others with their signs.

    Mean over the others of the logarithm of the ratio of residuals; 0 for a single video.
    """
    M = len(evidence)
    if M < 2:
        return np.zeros(M)
    off_diagonal = evidence - np.diag(np.diag(evidence))
    return np.asarray(-(off_diagonal @ signs) / (M - 1))


def find_mirrored(
    evidence: Float[np.ndarray, "M M"], pinned: Sequence[bool]
) -> tuple[list[int], Float[np.ndarray, " M"]]:
    """The mirrored videos, and every video's margin: positive fits better reflected."""
    signs = signs_of(evidence, pinned)
    margins = mirror_margins(evidence, signs)
    mirrored = [int(v) for v in np.flatnonzero((signs < 0) & (margins > LEAST_MARGIN))]
    return mirrored, margins
