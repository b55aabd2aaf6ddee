"""Variation: how the performances of one action differ (Eq. 4 as a distribution).

A performance is ``X_v = M + sum_k s_vk B_k + r_v``: the mean motion, K modes of variation with a
score a performance, and a rest of its own. It is Eq. 4 with the mean removed, and noise in it.

Modes are principal components of the joints' places, which keypoints determine; turns follow by
regression on the scores, as a limb's twist would otherwise pass for a way to differ. A mode counts
if half of the joints and moments of a performance that it was not learned from predict the rest.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from imocap_core.biomechanics.joint_angles import MeanCurve
from imocap_core.rotations import exp

_ROUND_OFF = 1e-9  # singular values below this share of the largest are round-off


@dataclass(frozen=True, eq=False)
class Modes:
    """K modes of variation, the strongest first.

    Performance m is about the mean motion turned by ``sum_k scores[m, k] * turns[k]``.

    Attributes:
        share: of the performances' summed squared displacements.
        scores: in standard deviations; they sum to 0 over the performances.
        turns: rotation vectors from the mean, in the joint's own axes, radians, at a score of 1.
        shifts: of the joints from their mean places, metres, at a score of 1.
    """

    share: Float[np.ndarray, " K"]
    scores: Float[np.ndarray, "M K"]
    turns: Float[np.ndarray, "K N J 3"]
    shifts: Float[np.ndarray, "K N J 3"]

    def of_joints(self) -> Float[np.ndarray, "K J"]:
        """Size of each mode in each joint at one standard deviation, degrees, root mean square
        over the moments."""
        return np.asarray(np.rad2deg(np.sqrt((self.turns**2).sum(-1).mean(1))))

    def first(self, count: int) -> Modes:
        """The strongest of them."""
        return Modes(
            self.share[:count], self.scores[:, :count], self.turns[:count], self.shifts[:count]
        )


def modes(turns: Float[np.ndarray, "M N J 3"], shifts: Float[np.ndarray, "M N J 3"]) -> Modes:
    """Principal components over the performances of their displacements; at most M - 1.

    Args:
        turns, shifts: deviations from the mean (`technique.MeanMotion`): radians, metres. Moments
            that a performance does not show are 0, like the mean.
    """
    M = len(shifts)
    U, sigma, _ = np.linalg.svd(_centred(shifts), full_matrices=False)
    chosen = np.flatnonzero(sigma > _ROUND_OFF * max(float(sigma.max(initial=0.0)), 1e-12))[: M - 1]
    scores = U[:, chosen] * np.sqrt(max(M - 1, 1))
    largest = np.abs(scores).argmax(0)
    scores = scores * np.sign(scores[largest, np.arange(len(chosen))])  # the largest is positive
    at_one = scores.T / max(M - 1, 1)  # regression on scores of variance 1
    squares = sigma[chosen] ** 2
    return Modes(
        squares / max(float(squares.sum()), 1e-300),
        scores,
        (at_one @ _centred(turns)).reshape(-1, *turns.shape[1:]),
        (at_one @ _centred(shifts)).reshape(-1, *shifts.shape[1:]),
    )


def _centred(deviations: Float[np.ndarray, "M N J 3"]) -> Float[np.ndarray, "M D"]:
    rows = deviations.reshape(len(deviations), -1)
    return np.asarray(rows - rows.mean(0))


_MOST_MODES = 6
LEAST_PERFORMANCES = 4  # of fewer nothing is left to learn modes from
_LEAST_GAIN = 0.05  # of the error of a held-out performance: what a further mode has to predict
_BLOCK_S = 0.25  # of a joint's course: neighbouring moments do not count as held out
_DIVISIONS = 4


def held_out_errors(
    shifts: Float[np.ndarray, "M N J 3"], fps: float, rng: np.random.Generator
) -> Float[np.ndarray, " K1"]:
    """Squared error of held-out halves of held-out performances by 0, 1, 2, ... modes of the
    others, as shares of the error by none; 0 modes alone of fewer than `LEAST_PERFORMANCES`.

    shifts: deviations from the mean, metres; fps: moments a second.
    """
    M, N, J, _ = shifts.shape
    if M < LEAST_PERFORMANCES:
        return np.ones(1)
    rows = shifts.reshape(M, -1)
    blocks = np.arange(N) // max(1, round(_BLOCK_S * fps))
    count = min(_MOST_MODES, M - 3)
    errors = np.zeros(count + 1)
    for m in range(M):
        others = np.delete(rows, m, axis=0)
        mean = others.mean(0)
        _, sigma, Vh = np.linalg.svd(others - mean, full_matrices=False)
        for _division in range(_DIVISIONS):
            given = rng.random((blocks[-1] + 1, J))[blocks] < 0.5
            mask = np.repeat(given.ravel(), 3)
            errors += _errors_by_modes(rows[m] - mean, mask, sigma[: M - 2], Vh, count)
    return np.asarray(errors / max(errors[0], 1e-300))


def _errors_by_modes(
    deviation: Float[np.ndarray, " D"],
    given: Bool[np.ndarray, " D"],
    sigma: Float[np.ndarray, " K"],
    Vh: Float[np.ndarray, "R D"],
    count: int,
) -> Float[np.ndarray, " K1"]:
    """Squared error of the rest of a deviation, by 0 to ``count`` modes of which the given part
    tells the scores: least squares, with the scores' variances and that of the rest as prior."""
    variance, rest = sigma**2 / max(len(sigma) - 1, 1), ~given
    errors = [float((deviation[rest] ** 2).sum())]
    for k in range(1, count + 1):
        B, noise = Vh[:k].T, max(float(variance[k:].sum()) / Vh.shape[1], 1e-12)
        prior = np.diag(noise / np.maximum(variance[:k], 1e-12))
        scores = np.linalg.solve(B[given].T @ B[given] + prior, B[given].T @ deviation[given])
        errors.append(float(((deviation[rest] - B[rest] @ scores) ** 2).sum()))
    return np.array(errors)


def number_of_modes(errors: Float[np.ndarray, " K1"]) -> int:
    """As many modes as each lower the held-out error by `_LEAST_GAIN` of that by none."""
    gains = errors[:-1] - errors[1:]
    worse: Int[np.ndarray, " _"] = np.flatnonzero(gains < _LEAST_GAIN)
    return int(worse[0]) if len(worse) else len(gains)


@dataclass(frozen=True, eq=False)
class Variation:
    """The distribution of an action's motion over its performances.

    Attributes:
        ids: of the M performances; phase_s: (N,) moments, seconds of the reference.
        joint_names: J of SMPL's, the pelvis first.
        R_local: (N, J, 3, 3) the mean motion, every joint against its parent, y up, facing +z.
        joints: (N, J, 3) its places from the pelvis, metres.
        modes: those that predict held-out performances; there may be none.
        held_out: errors of held-out performances by 0, 1, 2, ... modes (`held_out_errors`).
        angles: mean and standard deviation over performances, by name.
    """

    ids: tuple[str, ...]
    phase_s: Float[np.ndarray, " N"]
    joint_names: tuple[str, ...]
    R_local: Float[np.ndarray, "N J 3 3"]
    joints: Float[np.ndarray, "N J 3"]
    modes: Modes
    held_out: Float[np.ndarray, " K1"]
    angles: Mapping[str, MeanCurve]

    def __repr__(self) -> str:
        return f"<Variation of {len(self.ids)} performances: {len(self.modes.share)} modes>"

    def at(self, scores: Float[np.ndarray, " K"]) -> Float[np.ndarray, "N J 3 3"]:
        """Rotations of the motion at some scores, in standard deviations of each mode.

        ValueError unless there is a number a mode.
        """
        given = np.asarray(scores, dtype=np.float64)
        if given.shape != self.modes.share.shape:
            raise ValueError(f"scores: expected {len(self.modes.share)} numbers, got {given.shape}")
        turned = exp(torch.as_tensor(np.einsum("k,knjx->njx", given, self.modes.turns)))
        return np.asarray(self.R_local @ turned.numpy())

    def draw(self, rng: np.random.Generator) -> Float[np.ndarray, "N J 3 3"]:
        """Rotations of a performance as there might be another: its modes at random."""
        return self.at(rng.normal(size=len(self.modes.share)))
