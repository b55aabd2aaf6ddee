"""Comparison: mean, spread and modes of an action's performances, and two performers."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from imocap_core.biomechanics.joint_angles import MeanCurve, joint_angles_deg, mean_curve, near
from imocap_core.body import Shaped
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.errors import WorkFailed
from imocap_core.motion.multiview.modes import Modes, held_out_errors, modes, number_of_modes
from imocap_core.motion.multiview.timeline import frame_positions, sample_rotations, values_at
from imocap_core.params import SyncParams
from imocap_core.result.body import body_model, local_rotations
from imocap_core.result.result import ActionResult
from imocap_core.result.video_motion import video_angles
from imocap_core.sync import SyncEvidence, synchronise
from imocap_core.technique import (
    SHOWN,
    AlignedPerformances,
    Difference,
    MeanMotion,
    at_moments,
    consistency,
    difference,
    facing_alike,
    heading,
    mean_motion,
    mean_over,
    spread,
    to_the_front,
    turned_by,
)
from imocap_core.variation import Variation

_BODY_JOINTS = SMPL_JOINTS[:22]  # body keypoints do not determine SMPL's hand joints


@dataclass(frozen=True, eq=False)
class Performances:
    """One action's performances, ready to be compared.

    instances: facing alike, at the moments of `compared_moments`. clock_s (M, N): seconds of each
    video's own clock at these. shaped: the body that all are put on. fps: moments a second.
    left_out: performances not among them, and why. error_deg, open_deg (M, N): the angles' expected
    errors, and these with the motion common to all given; empty where they are not known.
    """

    action: str
    instances: AlignedPerformances
    clock_s: Float[np.ndarray, "M N"]
    shaped: Shaped
    fps: float
    left_out: tuple[str, ...]
    error_deg: dict[str, Float[np.ndarray, "M N"]]
    open_deg: dict[str, Float[np.ndarray, "M N"]]


def performers_of(result: ActionResult) -> list[str]:
    """The performers declared of the videos that can be compared, in order of appearance."""
    placed = [v for v in result.on_common_time() if v.id not in result.sync.mirrored]
    return list(dict.fromkeys(v.performer for v in placed if v.performer is not None))


def performances_of(
    result: ActionResult, body: Shaped | None = None, performer: str | None = None
) -> Performances:
    """Performances of an action, or of one performer in it, in a level world (y up), on `body` or
    the reference's.

    WorkFailed when no video has a place on the common axis.
    """
    level = result.levelled("y")
    common = level.on_common_time()
    mirrored = [v.id for v in common if v.id in result.sync.mirrored]
    used = [v for v in common if v.id not in mirrored]
    if performer is not None:
        used = [v for v in used if v.performer == performer]
    shaped = body or _reference_body(result)
    R = np.stack([local_rotations(v.theta) for v in used])
    placed = shaped.pose(torch.as_tensor(R), torch.zeros(3, dtype=torch.float64)).joints.numpy()
    count = len(_BODY_JOINTS)
    instances = AlignedPerformances(
        ids=tuple(v.id for v in used),
        joint_names=_BODY_JOINTS,
        phase_s=used[0].phase_s,
        R_local=R[:, :, :count],
        joints=(placed - placed[:, :, :1])[:, :, :count],
        inside=np.stack([v.inside for v in used]),
    )
    moments = compared_moments(instances.inside)
    instances = to_the_front(facing_alike(at_moments(instances, moments)))
    angles = [video_angles(v, "y", level.ground.tilt_sd_deg) for v in used]
    clocks = [
        frame_positions(result[i].phase_s, instances.phase_s).position / result[i].fps
        for i in instances.ids
    ]
    return Performances(
        action=result.action if performer is None else performer,
        instances=instances,
        clock_s=np.stack(clocks),
        shaped=shaped,
        fps=used[0].fps,
        left_out=(
            *(f"{i}: no place on the common axis" for i in common.left_out),
            *(f"{i}: mirrored" for i in mirrored),
        ),
        error_deg=_shown([a.sd_deg for a in angles], moments),
        open_deg=_shown([a.deviation_sd_deg for a in angles], moments),
    )


def _shown(
    spreads: list[dict[str, Float[np.ndarray, " _"]]], moments: Bool[np.ndarray, " _"]
) -> dict[str, Float[np.ndarray, "M N"]]:
    """Of every angle shown and performance, at some moments; empty where they are not known."""
    return {n: np.stack([of[n][moments] for of in spreads]) for n in SHOWN if all(spreads)}


def compared_moments(inside: Bool[np.ndarray, "M N"]) -> Bool[np.ndarray, " N"]:
    """Which of N moments to compare, given which performances show them (M, N).

    The moments that all performances show; where these are fewer than half of those that at least
    two show (one video is short), the latter.
    """
    shown = inside.sum(0)
    everyone, two = shown == len(inside), shown >= min(2, len(inside))
    return everyone if 2 * everyone.sum() >= two.sum() else two


def several(performances: Performances) -> Performances:
    """The same; WorkFailed unless there are at least two performances to compare."""
    if len(performances.instances.ids) < 2:
        raise WorkFailed(
            f"{performances.action} has one performance, and its spread needs two or more: add "
            f"videos, say `repetitions: true` of a long clip in action.yaml, or name a second "
            f"action"
        )
    return performances


def _reference_body(result: ActionResult) -> Shaped:
    reference = result[result.reference]
    model = body_model(reference.model, reference.action, hands=False)
    return model.shape(torch.as_tensor(reference.betas))


_LEAST = 3  # moments that two actions must share
Curves = dict[str, MeanCurve]


@dataclass(frozen=True, eq=False)
class Technique:
    """Mean, spread, consistency, modes and timing of one action's performances.

    spread_deg, spread_mm (N, J): standard deviation of every joint's rotation and place, NaN where
    fewer than two performances show the moment.
    consistency: docs/technique.md. modes: all. lead_s (M, N): how much later than the mean a
    performance reaches a moment, its own clock started where all of them are seen first.
    """

    performances: Performances
    mean: MeanMotion
    spread_deg: Float[np.ndarray, "N J"]
    spread_mm: Float[np.ndarray, "N J"]
    consistency: float
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
    return Technique(
        performances=performances,
        mean=mean,
        spread_deg=turned,
        spread_mm=moved,
        consistency=consistency(each.joints, each.inside) if len(each.ids) > 1 else np.nan,
        modes=modes(mean.turns, mean.shifts),
        lead_s=_lead_s(performances.clock_s, each.inside),
    )


def variation_of(t: Technique, angles: Curves) -> Variation:
    """The distribution of an action's motion over its performances; angles: their means."""
    errors = held_out_errors(t.mean.shifts, t.performances.fps, np.random.default_rng(0))
    return Variation(
        ids=t.instances.ids,
        phase_s=t.instances.phase_s,
        joint_names=t.instances.joint_names,
        R_local=t.mean.R_local,
        joints=t.mean.joints,
        modes=t.modes.first(number_of_modes(errors)),
        held_out=errors,
        angles=angles,
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
    evidence = SyncEvidence(
        means, fps=[first.performances.fps, second.performances.fps], reference=0
    )
    sync = synchronise(evidence, settings, rng)
    axis = np.arange(len(means[0])) / first.performances.fps
    matched = np.isfinite(sync.reference_frame[1])
    phase = np.where(matched, sync.phase[1], np.nan)
    m = frame_positions(phase, axis) if matched.any() else None
    index = np.zeros(0, dtype=np.int64) if m is None else np.flatnonzero(m.inside)
    if m is None or len(index) < _LEAST:
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
    if len(index) < _LEAST:
        raise WorkFailed(
            f"{first.action} and {second.action} share {len(index)} moments of the action, and "
            f"{_LEAST} are needed; add videos that show the same part of it"
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


@dataclass(frozen=True, eq=False)
class TechniqueAngles:
    """Angles at N moments by name: mean and deviation over the performances, and each of these.

    each (M, N): degrees, NaN where a performance does not show the moment.
    """

    mean: Curves
    each: dict[str, Float[np.ndarray, "M N"]]


def technique_angles(t: Technique) -> TechniqueAngles:
    """Angles of an action's performances, at its moments."""
    rest = t.performances.shaped.joints_rest.numpy()[: len(SMPL_JOINTS)]
    of_each = [joint_angles_deg(in_smpl(R), rest) for R in t.instances.R_local]
    inside = list(t.instances.inside)
    left_open = t.performances.open_deg
    mean = {
        name: mean_curve([a[name] for a in of_each], inside, [*left_open.get(name, ())])
        for name in SHOWN
    }
    each = {
        name: np.stack(
            [
                near(np.where(i, a[name], np.nan), mean[name].mean_deg)
                for a, i in zip(of_each, inside, strict=True)
            ]
        )
        for name in SHOWN
    }
    return TechniqueAngles(mean, each)


def pair_angles(pair: TechniquePair) -> tuple[TechniqueAngles, TechniqueAngles]:
    """Both performers' angles, at the pair's moments."""
    first, second = technique_angles(pair.first), technique_angles(pair.second)
    clock = pair.second.instances.phase_s
    frame = np.interp(pair.second_s, clock, np.arange(len(clock)))
    of_first = {
        name: MeanCurve(c.mean_deg[pair.index], c.sd_deg[pair.index], c.n[pair.index])
        for name, c in first.mean.items()
    }
    of_second = {
        name: MeanCurve(
            near(values_at(c.mean_deg, frame), of_first[name].mean_deg),
            values_at(c.sd_deg, frame),
            c.n[np.rint(frame).astype(np.int64)],
        )
        for name, c in second.mean.items()
    }
    ours = {name: rows[:, pair.index] for name, rows in first.each.items()}
    theirs = {
        name: np.stack([near(values_at(row, frame), of_first[name].mean_deg) for row in rows])
        for name, rows in second.each.items()
    }
    return TechniqueAngles(of_first, ours), TechniqueAngles(of_second, theirs)


def expected_error_deg(pair: TechniquePair) -> dict[str, Float[np.ndarray, " N"]]:
    """Of the difference of both performers' mean angles, at the pair's moments, where it is known.

    Videos that are solved together share their errors: a mean errs as its performances do.
    """
    first, second = (t.performances.error_deg for t in (pair.first, pair.second))
    clock = pair.second.instances.phase_s
    nearest = np.rint(np.interp(pair.second_s, clock, np.arange(len(clock)))).astype(np.int64)

    def squared(errors: Float[np.ndarray, "M N"]) -> Float[np.ndarray, " N"]:
        return np.asarray(np.mean(errors**2, axis=0))

    return {
        name: np.sqrt(squared(first[name][:, pair.index]) + squared(second[name][:, nearest]))
        for name in first.keys() & second.keys()
    }


def in_smpl(R_local: Float[np.ndarray, "N J 3 3"]) -> Float[np.ndarray, "N 24 3 3"]:
    """Rotations of SMPL's first J joints with the others at rest."""
    R = np.tile(np.eye(3), (len(R_local), len(SMPL_JOINTS), 1, 1))
    R[:, : R_local.shape[1]] = R_local
    return R
