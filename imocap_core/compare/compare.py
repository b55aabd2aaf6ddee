"""compare: what performances of an action share, how they differ, and two performers."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from imocap_core.compare.sources import Gathered
from imocap_core.errors import WorkFailed
from imocap_core.motion.multiview.common_time import moments_of, values_at
from imocap_core.motion.multiview.timeline import sample_rotations
from imocap_core.params import SyncParams
from imocap_core.problem.synchronisation import joint_weights_of
from imocap_core.sync import synchronise
from imocap_core.technique.consistency import consistency
from imocap_core.technique.difference import Difference, difference
from imocap_core.technique.mean_motion import MeanMotion, mean_motion, over_moments, spread
from imocap_core.technique.modes import Modes, modes
from imocap_core.technique.performances import AlignedPerformances, heading, mean_over, turned_by

Array = NDArray[np.float64]

LEAST = 3  # moments that two actions must share


@dataclass(frozen=True, eq=False)
class Technique:
    """One action's performances, described.

    spread_deg, spread_mm (N, J): standard deviation of every joint's rotation and place, NaN where
    fewer than two performances show the moment; joint_deg, joint_mm (J,) their root mean squares.
    consistency (J,), whole: docs/technique.md. lead_s (M, N): how much later than the mean a
    performance reaches a moment, its own clock started where all of them are seen first.
    """

    gathered: Gathered
    mean: MeanMotion
    spread_deg: Array
    spread_mm: Array
    joint_deg: Array
    joint_mm: Array
    consistency: Array
    whole: float
    modes: Modes
    lead_s: Array

    @property
    def instances(self) -> AlignedPerformances:
        """The performances."""
        return self.gathered.instances


def describe(gathered: Gathered) -> Technique:
    """Mean, spread, consistency, modes and timing of an action's performances."""
    found = gathered.instances
    mean = mean_motion(found)
    turned = np.rad2deg(spread(mean.turns, found.inside))
    moved = 1000 * spread(mean.shifts, found.inside)
    alone = len(found.ids) < 2
    nothing = np.full(len(found.joint_names), np.nan)
    per_joint, whole = (nothing, np.nan) if alone else consistency(found.joints, found.inside)
    return Technique(
        gathered=gathered,
        mean=mean,
        spread_deg=turned,
        spread_mm=moved,
        joint_deg=over_moments(turned),
        joint_mm=over_moments(moved),
        consistency=per_joint,
        whole=whole,
        modes=modes(mean.turns),
        lead_s=_lead_s(gathered.own_s, found.inside),
    )


def _lead_s(own_s: Array, inside: NDArray[np.bool_]) -> Array:
    """(M, N) own seconds since the first moment that all show, less their mean; NaN outside."""
    everyone = np.flatnonzero(inside.all(0))
    if not len(everyone):
        return np.full(own_s.shape, np.nan)
    since = own_s - own_s[:, everyone[:1]]
    late = since - mean_over(since, inside.astype(np.float64))
    return np.where(inside, late, np.nan)


@dataclass(frozen=True, eq=False)
class Pair:
    """Two actions on the first one's phase axis.

    phase_s (N,): the moments of the first that the second shows too. first, second: means at these
    moments, facing one way, on the first's body. second_s (N,): the second's own phase there.
    """

    first: Technique
    second: Technique
    phase_s: Array
    at_first: NDArray[np.int64]
    places: tuple[Array, Array]
    second_s: Array
    difference: Difference


def pair_of(
    first: Technique, second: Technique, params: SyncParams, rng: np.random.Generator
) -> Pair:
    """The second action's mean brought onto the first's axis by the synchronisation's core.

    WorkFailed when the two share no moment.
    """
    means = [t.mean.joints for t in (first, second)]
    settings = replace(params, outliers="ignore", mirrored="ignore")
    weights = joint_weights_of(params)
    found = synchronise(
        means,
        fps=[first.gathered.fps, second.gathered.fps],
        settings=settings,
        rng=rng,
        joint_weights=None if weights is None else weights[: means[0].shape[1]],
        reference=0,
    )
    axis = np.arange(len(means[0])) / first.gathered.fps
    matched = np.isfinite(found.reference_frame[1])
    known = np.where(matched, found.phase[1], np.nan)
    m = moments_of(known, axis) if matched.any() else None
    keep = np.zeros(0, dtype=np.int64) if m is None else np.flatnonzero(m.inside)
    if m is None or len(keep) < LEAST:
        raise WorkFailed(
            f"{first.gathered.action} and {second.gathered.action} share no course of moments: "
            f"{len(keep)} of {len(axis)} match; name two performers of one action"
        )
    return _difference(first, second, keep, m.at[keep])


def _difference(first: Technique, second: Technique, keep: NDArray[np.int64], at: Array) -> Pair:
    """At the moments `keep` of the first, frames `at` (fractional) of the second's mean."""
    nearest = np.rint(at).astype(np.int64)
    ours, theirs = first.mean.joints[keep], values_at(second.mean.joints, at)
    R_theirs = sample_rotations(torch.as_tensor(second.mean.R_local), at).numpy()
    turn = heading(theirs, ours, np.ones(len(keep)))
    turned = turned_by(
        AlignedPerformances(
            ids=("mean",),
            joint_names=second.instances.joint_names,
            phase_s=first.instances.phase_s[keep],
            R_local=R_theirs[None],
            joints=theirs[None],
            inside=np.ones((1, len(keep)), dtype=bool),
        ),
        np.array([turn]),
    )
    return Pair(
        first=first,
        second=second,
        phase_s=first.instances.phase_s[keep],
        at_first=keep,
        places=(ours, turned.joints[0]),
        second_s=values_at(second.instances.phase_s, at),
        difference=difference(
            first.mean.R_local[keep],
            turned.R_local[0],
            ours,
            turned.joints[0],
            first.spread_mm[keep] / 1000,
            second.spread_mm[nearest] / 1000,
        ),
    )
