"""Synchronisation within the loop: who takes part, its start, and its confidence.

Which videos take part, and which are mirrored, is decided again by the joint motion, in which a
wrong monocular start has been put right or left out (docs/decisions.md).

In the loop every pose has been drawn towards those that it is matched with, rightly or wrongly, and
confirms its match ever after. Where all videos show one motion the keypoints contradict a wrong
match. Where performances differ, the difference explains it as well: there a match is no surer than
the monocular motions made it, which knew nothing of each other, and those tell, too, whether it
fits as well a repetition later.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from imocap_core.adapters.hints import with_one_offset
from imocap_core.adapters.hypotheses import chosen_motions, unfit_videos
from imocap_core.adapters.joint import JointProblem, is_one_motion, shows_one_motion
from imocap_core.adapters.synchronisation import evidence_of, summary_of, synchronise_motions
from imocap_core.artifacts.schemas import (
    CameraMotion,
    InitialSmpl,
    Keypoints,
    Sync,
    SyncMap,
    SyncSummary,
    SyncTrust,
)
from imocap_core.motion.multiview.alternation import LoopRound
from imocap_core.motion.multiview.scene import DeviationSpread, JointMotion
from imocap_core.params import SyncParams
from imocap_core.sync import Hints, SyncEvidence, screened
from imocap_core.sync.screening.screening import Screening, corrected, sentences


def decided_again(first: SyncSummary, second: Screening) -> SyncSummary | None:
    """The first synchronisation with a second screening's decisions; None where they are the same.

    Args:
        second: of the same videos, with the joint motion where they took part.
    """
    excluded, mirrored = (
        [first.ids[v] for v in videos] for videos in (second.excluded, second.flipped)
    )
    changed = {*excluded} ^ {*first.excluded} | {*mirrored} ^ {*first.mirrored}
    if not changed:
        return None
    notes = corrected(
        first.notes,
        sentences(second, first.ids),
        changed=changed,
        returned=[video for video in first.excluded if video not in excluded],
        straight=[v for v in first.mirrored if v not in mirrored and v not in excluded],
    )
    return first.model_copy(update={"excluded": excluded, "mirrored": mirrored, "notes": notes})


def with_independent_confidence(
    sync: Sync, first: SyncSummary, spread: DeviationSpread | None
) -> Sync:
    """The loop's correspondences, of differing performances no surer than `first`, those of the
    monocular motions. Frames that these left unmatched are as sure as their neighbours.

    Args:
        spread: of the motion that the correspondences were found with.
    """
    if spread is None or is_one_motion(spread.keypoints_m, spread.offset_sd):
        return sync
    monocular = {m.id: m for m in first.maps}
    maps = [
        m
        if m.id == sync.reference
        else m.model_copy(
            update={"confidence": np.minimum(m.confidence, _everywhere(monocular[m.id]))}
        )
        for m in sync.maps
    ]
    return sync.model_copy(update={"maps": maps, "trust": _no_surer(sync.trust, first.trust)})


def _no_surer(trust: SyncTrust | None, first: SyncTrust | None) -> SyncTrust | None:
    """With every phase no surer than at first."""
    if trust is None or first is None:
        return trust
    at_first = {v.id: v.phase_confidence for v in first.videos}
    videos = []
    for video in trust.videos:
        limit, confidence = at_first[video.id], video.phase_confidence
        if limit is not None and confidence is not None:
            lower = np.minimum(confidence, limit)
            video = video.model_copy(update={"phase_confidence": lower})
        videos.append(video)
    return trust.model_copy(update={"videos": videos})


def with_first_repetitions(sync: Sync, first: SyncSummary) -> Sync:
    """The loop's correspondences with what `first`, those of the monocular motions, say of maps
    shifted by a repetition; the same video must be the reference of both."""
    if sync.trust is None or first.trust is None or sync.reference != first.reference:
        return sync
    names = ("repetition_s", "repetition_ratio")
    by_id = {v.id: {name: getattr(v, name) for name in names} for v in first.trust.videos}
    videos = [v.model_copy(update=by_id.get(v.id, {})) for v in sync.trust.videos]
    return sync.model_copy(update={"trust": sync.trust.model_copy(update={"videos": videos})})


def _everywhere(sync_map: SyncMap) -> Float[np.ndarray, " T"]:
    """Confidence of every frame, of unmatched ones that of their matched neighbours."""
    matched = np.flatnonzero(np.isfinite(sync_map.reference_frame))
    every = np.arange(len(sync_map.confidence))
    if not len(matched):
        return np.zeros(len(every))
    return np.asarray(np.interp(every, matched, sync_map.confidence[matched]))


SAME_S = 0.25  # correspondences further apart are not the same: another cycle of a repeated action
Solve = Callable[[SyncSummary], tuple[JointProblem, JointMotion]]


@dataclass(frozen=True)
class LoopBeginning:
    """Where the loop begins.

    Attributes:
        problem, single_pass: with its videos, on its time axis.
        moved: whether videos or reference are others than those of the stored single pass.
    """

    problem: JointProblem
    single_pass: LoopRound[SyncSummary, JointMotion]
    moved: bool


@dataclass(frozen=True)
class LoopSync:
    """What every synchronisation of the loop goes by, besides the motion.

    Attributes:
        hints: with those of sound, if any; rates: seconds of the action per second of each video.
        by_pictures: keypoints are evidence too, where three videos or more show one motion. Of two
            performances those moments that look alike in a picture need not belong together, and
            two videos explain each other too well.
        event: all videos show one performance; sound_start_s: when each began, by its sound.
        declared: per video True or False where the user states whether it is mirrored.
        rng: a generator, the same one whenever it is asked for.
    """

    keypoints: Keypoints
    cameras: CameraMotion
    initial: InitialSmpl
    params: SyncParams
    hints: Hints
    rates: Float[np.ndarray, " M"]
    by_pictures: bool
    event: bool
    sound_start_s: Float[np.ndarray, " M"] | None
    declared: Sequence[bool | None]
    rng: Callable[[], np.random.Generator]

    def beginning(
        self, problem: JointProblem, single_pass: LoopRound[SyncSummary, JointMotion], solve: Solve
    ) -> tuple[LoopBeginning, Sync | None]:
        """Where the loop begins, and the correspondences of the motion that it begins with, where
        they are at hand.

        Args:
            solve: the single pass with other correspondences.
        """
        decided = self._decided_again(problem, single_pass)
        if decided is not None:
            first = summary_of(self._of_monocular_motions(decided, None))
            problem, motion = solve(first)
            single_pass = LoopRound(first, motion, motion.misfit, 0.0)
        first = single_pass.sync
        sync = self._of_motion(problem, single_pass.motion, first, None)
        if sync.reference == first.reference:
            return LoopBeginning(problem, single_pass, decided is not None), sync
        of_motion = summary_of(sync)
        del sync  # its memory is needed
        again = summary_of(self._of_monocular_motions(first, of_motion.reference))
        if self._apart_s(of_motion, again) > SAME_S:
            sync = self._of_motion(problem, single_pass.motion, first, first.reference)
            return LoopBeginning(problem, single_pass, decided is not None), sync
        problem, motion = problem.on_axis_of(again, single_pass.motion)
        return LoopBeginning(problem, replace(single_pass, sync=again, motion=motion), True), None

    def _apart_s(self, a: SyncSummary, b: SyncSummary) -> float:
        """The median distance of two correspondences on one axis, of the video where it is most."""
        fps = {video.id: video.fps for video in self.keypoints.videos}[a.reference]
        maps = {m.id: m.reference_frame for m in b.maps}
        apart = [np.abs(m.reference_frame - maps[m.id]) / fps for m in a.maps]
        return max(float(np.median(x[np.isfinite(x)])) for x in apart if np.isfinite(x).any())

    def first_of(self, begun: LoopBeginning) -> Sync:
        """The correspondences that the loop begins with, as a whole."""
        first = begun.single_pass.sync
        return self._of_monocular_motions(first, first.reference)

    def of_motion(self, begun: LoopBeginning, motion: JointMotion) -> Sync:
        """The correspondences of a motion, with the loop's videos and on its axis."""
        first = begun.single_pass.sync
        return self._of_motion(begun.problem, motion, first, first.reference)

    def _decided_again(
        self, problem: JointProblem, single_pass: LoopRound[SyncSummary, JointMotion]
    ) -> SyncSummary | None:
        """The first synchronisation's decisions, if the joint motion decides otherwise."""
        first = single_pass.sync
        joints = problem.filmed_joints(single_pass.motion)
        unfit = unfit_videos(self.initial)
        evidence = evidence_of(joints, self.keypoints, self.hints, self.cameras, unfit)
        evidence = replace(evidence, mirrored=self.declared, rates=self.rates)
        return decided_again(first, screened(evidence, self.params))

    def _of_motion(
        self,
        problem: JointProblem,
        motion: JointMotion,
        decided: SyncSummary,
        reference: str | None,
    ) -> Sync:
        several = len(decided.ids) - len(decided.excluded) > 2
        pictures = self.by_pictures and several and shows_one_motion(motion)
        joints = problem.filmed_joints(motion)
        evidence = replace(
            evidence_of(joints, self.keypoints, self.hints, self.cameras),
            reprojection=problem.reprojection_evidence(motion) if pictures else None,
            rates=self.rates,
        )
        return self._synchronised(evidence, decided, reference)

    def _of_monocular_motions(self, decided: SyncSummary, reference: str | None) -> Sync:
        """The first synchronisation again, with other videos or on another time axis."""
        chosen = decided.alternatives
        joints = [motion.joints for motion in chosen_motions(self.initial, chosen)]
        evidence = evidence_of(joints, self.keypoints, self.hints, self.cameras)
        return self._synchronised(evidence, decided, reference)

    def _synchronised(
        self, evidence: SyncEvidence, decided: SyncSummary, reference: str | None
    ) -> Sync:
        """Synchronised; correspondences of one event are one offset and rate a video."""
        sync = synchronise_motions(
            evidence, self.keypoints, self.params, self.rng(), reference=reference, decided=decided
        )
        return with_one_offset(sync, self.keypoints, self.sound_start_s) if self.event else sync
