"""Comparison: mean, spread and modes of an action's performances, and two performers."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from imocap_core.compare.sources import Performances
from imocap_core.errors import WorkFailed
from imocap_core.motion.multiview.common_time import frame_positions, values_at
from imocap_core.motion.multiview.timeline import sample_rotations
from imocap_core.params import SyncParams
from imocap_core.problem.synchronisation import joint_weights_of
from imocap_core.sync import synchronise
from imocap_core.technique.consistency import consistency
from imocap_core.technique.difference import Difference, difference
from imocap_core.technique.mean_motion import MeanMotion, mean_motion, over_moments, spread
from imocap_core.technique.modes import Modes, modes
from imocap_core.technique.performances import AlignedPerformances, heading, mean_over, turned_by

LEAST = 3  # moments that two actions must share


@dataclass(frozen=True, eq=False)
class Technique:
    """Mean, spread, consistency, modes and timing of one action's performances.

    spread_deg, spread_mm (N, J): standard deviation of every joint's rotation and place, NaN where
    fewer than two performances show the moment; joint_deg, joint_mm (J,) their root mean squares.
    consistency (J,), whole: docs/technique.md. lead_s (M, N): how much later than the mean a
    performance reaches a moment, its own clock started where all of them are seen first.
    """

    performances: Performances
    mean: MeanMotion
    spread_deg: Float[np.ndarray, "N J"]
    spread_mm: Float[np.ndarray, "N J"]
    joint_deg: Float[np.ndarray, " J"]
    joint_mm: Float[np.ndarray, " J"]
    consistency: Float[np.ndarray, " J"]
    whole: float
    modes: Modes
    lead_s: Float[np.ndarray, "M N"]

    @property
    def action(self) -> str:
        """The action's name."""
        return self.performances.action

    @property
    def instances(self) -> AlignedPerformances:
        """The performances at common moments."""
        return self.performances.instances


def describe(performances: Performances) -> Technique:
    """Mean, spread, consistency, modes and timing of an action's performances."""
    each = performances.instances
    mean = mean_motion(each)
    turned = np.rad2deg(spread(mean.turns, each.inside))
    moved = 1000 * spread(mean.shifts, each.inside)
    alone = len(each.ids) < 2
    nothing = np.full(len(each.joint_names), np.nan)
    per_joint, whole = (nothing, np.nan) if alone else consistency(each.joints, each.inside)
    return Technique(
        performances=performances,
        mean=mean,
        spread_deg=turned,
        spread_mm=moved,
        joint_deg=over_moments(turned),
        joint_mm=over_moments(moved),
        consistency=per_joint,
        whole=whole,
        modes=modes(mean.turns),
        lead_s=_lead_s(performances.clock_s, each.inside),
    )


def _lead_s(
    clock_s: Float[np.ndarray, "M N"], inside: Bool[np.ndarray, "M N"]
) -> Float[np.ndarray, "M N"]:
    """Seconds of each video since the first moment that all show, less their mean; NaN outside."""
    everyone = np.flatnonzero(inside.all(0))
    if not len(everyone):
        return np.full(clock_s.shape, np.nan)
    since = clock_s - clock_s[:, everyone[:1]]
    late = since - mean_over(since, inside.astype(np.float64))
    return np.where(inside, late, np.nan)


@dataclass(frozen=True, eq=False)
class TechniquePair:
    """Two actions on the first one's phase axis.

    phase_s (N,): the moments of the first that the second shows too. index (N,): these among all
    moments of the first. joints: both means (N, J, 3) there, metres from the pelvis, facing one
    way, on the first's body; rotations: theirs, against the parents. second_s (N,): the second's
    own phase there.
    """

    first: Technique
    second: Technique
    phase_s: Float[np.ndarray, " N"]
    index: Int[np.ndarray, " N"]
    joints: tuple[Float[np.ndarray, "N J 3"], Float[np.ndarray, "N J 3"]]
    second_s: Float[np.ndarray, " N"]
    rotations: tuple[Float[np.ndarray, "N J 3 3"], Float[np.ndarray, "N J 3 3"]]
    difference: Difference


def pair_of(
    first: Technique, second: Technique, params: SyncParams, rng: np.random.Generator
) -> TechniquePair:
    """The second action's mean motion, synchronised with the first one's.

    WorkFailed when the two share no moment.
    """
    means = [t.mean.joints for t in (first, second)]
    settings = replace(params, outliers="ignore", mirrored="ignore")
    weights = joint_weights_of(params)
    sync = synchronise(
        means,
        fps=[first.performances.fps, second.performances.fps],
        params=settings,
        rng=rng,
        joint_weights=None if weights is None else weights[: means[0].shape[1]],
        reference=0,
    )
    axis = np.arange(len(means[0])) / first.performances.fps
    matched = np.isfinite(sync.reference_frame[1])
    phase = np.where(matched, sync.phase[1], np.nan)
    m = frame_positions(phase, axis) if matched.any() else None
    index = np.zeros(0, dtype=np.int64) if m is None else np.flatnonzero(m.inside)
    if m is None or len(index) < LEAST:
        raise WorkFailed(
            f"{first.action} and {second.action} cannot be synchronised: "
            f"{len(index)} of {len(axis)} moments match; name two performers of one action"
        )
    return _difference(first, second, index, m.position[index])


def pair_on_one_axis(first: Technique, second: Technique) -> TechniquePair:
    """Two performers of one action, at the moments of its common axis that both show.

    WorkFailed when there are too few of them.
    """
    a, b = first.instances.phase_s, second.instances.phase_s
    frame = np.interp(a, b, np.arange(len(b)), left=np.nan, right=np.nan)
    index = np.flatnonzero(np.isfinite(frame))
    if len(index) < LEAST:
        raise WorkFailed(
            f"{first.action} and {second.action} share {len(index)} moments of the action, and "
            f"{LEAST} are needed; add videos that show the same part of it"
        )
    return _difference(first, second, index, frame[index])


def _difference(
    first: Technique,
    second: Technique,
    index: Int[np.ndarray, " N"],
    frame: Float[np.ndarray, " N"],
) -> TechniquePair:
    """At moments of the first, and the fractional frames of the second's mean that match them."""
    nearest = np.rint(frame).astype(np.int64)
    ours, theirs = first.mean.joints[index], values_at(second.mean.joints, frame)
    R_theirs = sample_rotations(torch.as_tensor(second.mean.R_local), frame).numpy()
    turn = heading(theirs, ours, np.ones(len(index)))
    turned = turned_by(
        AlignedPerformances(
            ids=("mean",),
            joint_names=second.instances.joint_names,
            phase_s=first.instances.phase_s[index],
            R_local=R_theirs[None],
            joints=theirs[None],
            inside=np.ones((1, len(index)), dtype=bool),
        ),
        np.array([turn]),
    )
    return TechniquePair(
        first=first,
        second=second,
        phase_s=first.instances.phase_s[index],
        index=index,
        joints=(ours, turned.joints[0]),
        second_s=values_at(second.instances.phase_s, frame),
        rotations=(first.mean.R_local[index], turned.R_local[0]),
        difference=difference(
            first.mean.R_local[index],
            turned.R_local[0],
            ours,
            turned.joints[0],
            first.spread_mm[index] / 1000,
            second.spread_mm[nearest] / 1000,
        ),
    )
