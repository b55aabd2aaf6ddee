"""Synchronisation within the loop, and the time axis that it goes by.

Which video is the reference of the first synchronisation rests on monocular motions alone: one that
is wrong is like no other and not central, whatever its video shows. So the first joint motion
chooses again, and where that is another video the loop begins on its time axis
(docs/decisions/reference.md). It also decides again which videos take part
(docs/decisions/screening.md).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from imocap_core.artifacts.schemas import InitialSmpl, Keypoints, Sync, SyncSummary
from imocap_core.motion.multiview.alternation import LoopRound
from imocap_core.motion.multiview.scene import JointMotion
from imocap_core.params import SyncParams
from imocap_core.problem.event_timing import with_one_offset
from imocap_core.problem.hypotheses import chosen_motions, explained_keypoints
from imocap_core.problem.joint import JointProblem
from imocap_core.problem.screening_again import decided_again
from imocap_core.problem.sound import with_sound
from imocap_core.problem.synchronisation import rates_of_motions, summary_of, synchronise_motions
from imocap_core.sync import Hints


@dataclass(frozen=True)
class LoopBeginning:
    """Where the loop begins, on its time axis.

    Attributes:
        problem: on that axis; single_pass: with the first correspondences on it.
        moved: whether its reference is another video than that of the single pass.
    """

    problem: JointProblem
    single_pass: LoopRound[SyncSummary, JointMotion]
    moved: bool


@dataclass(frozen=True)
class LoopSync:
    """What every synchronisation of the loop goes by, besides the motion.

    Attributes:
        first: of the monocular motions; what it decided stays.
        hints: with those of sound, if any; rates: seconds of the action per second of each video.
        by_pictures: keypoints are evidence too; event: all videos show one performance.
        sound_start_s: when each video began, by its sound.
        declared: per video True or False where the user states whether it is mirrored.
        rng: a generator, the same one whenever it is asked for.
    """

    keypoints: Keypoints
    initial: InitialSmpl
    first: SyncSummary
    params: SyncParams
    hints: Hints
    rates: Float[np.ndarray, " M"]
    by_pictures: bool
    event: bool
    sound_start_s: Float[np.ndarray, " M"] | None
    declared: Sequence[bool | None]
    rng: Callable[[], np.random.Generator]

    @classmethod
    def of(
        cls,
        keypoints: Keypoints,
        initial: InitialSmpl,
        first: SyncSummary,
        params: SyncParams,
        hints: Hints,
        rng: Callable[[], np.random.Generator],
        *,
        by_pictures: bool,
        event: bool,
        sound_start_s: Float[np.ndarray, " M"] | None,
        declared: Sequence[bool | None],
    ) -> LoopSync:
        """With the hints of sound, and the rates of the monocular motions.

        Args:
            hints: of action.yaml; the others as of the attributes.
        """
        if sound_start_s is not None:
            hints = with_sound(hints, sound_start_s, keypoints)
        monocular = [video.joints for video in initial.videos]
        rates = rates_of_motions(monocular, keypoints, params, hints)
        return cls(
            keypoints, initial, first, params, hints, rates,
            by_pictures, event, sound_start_s, declared, rng,
        )  # fmt: skip

    def with_videos_of(self, problem: JointProblem, motion: JointMotion) -> LoopSync | None:
        """The same with the videos taking part, and mirrored, that the joint motion says; None
        where they are the same."""
        keypoints = explained_keypoints(self.initial, self.keypoints, self.first.alternatives)
        joints = problem.filmed_joints(motion)
        given = (joints, keypoints, self.rates, self.params, self.declared)
        first = decided_again(self.first, *given)
        return None if first is None else replace(self, first=first)

    def first_again(self) -> Sync:
        """The synchronisation of the monocular motions, with what has been decided since."""
        return self._placed(self._of_monocular_motions(None))

    def beginning(
        self, problem: JointProblem, single_pass: LoopRound[SyncSummary, JointMotion]
    ) -> tuple[LoopBeginning, Sync | None]:
        """The loop's time axis, chosen by the single pass's motion, and the correspondences of that
        motion, where they are on this axis already."""
        sync = self._of_motion(problem, single_pass.motion, None)
        if sync.reference == self.first.reference:
            return LoopBeginning(problem, single_pass, False), self._placed(sync)
        reference = sync.reference
        del sync  # its memory is needed
        first = summary_of(self._placed(self._of_monocular_motions(reference)))
        problem, motion = problem.on_axis_of(first, single_pass.motion)
        return LoopBeginning(problem, replace(single_pass, sync=first, motion=motion), True), None

    def of_motion(self, begun: LoopBeginning, motion: JointMotion) -> Sync:
        """The correspondences of a motion, on the loop's axis."""
        reference = begun.single_pass.sync.reference
        return self._placed(self._of_motion(begun.problem, motion, reference))

    def _placed(self, sync: Sync) -> Sync:
        """Correspondences of one event are one offset and rate a video."""
        return with_one_offset(sync, self.keypoints, self.sound_start_s) if self.event else sync

    def _of_motion(self, problem: JointProblem, motion: JointMotion, reference: str | None) -> Sync:
        return synchronise_motions(
            problem.filmed_joints(motion),
            self.keypoints,
            self.params,
            self.rng(),
            reference=reference,
            decided=self.first,
            hints=self.hints,
            reprojection=problem.reprojection_evidence(motion) if self.by_pictures else None,
            rates=self.rates,
        )

    def _of_monocular_motions(self, reference: str | None) -> Sync:
        """The first synchronisation again, on the time axis of some video."""
        chosen = self.first.alternatives
        return synchronise_motions(
            [motion.joints for motion in chosen_motions(self.initial, chosen)],
            explained_keypoints(self.initial, self.keypoints, chosen),
            self.params,
            self.rng(),
            reference=reference,
            decided=self.first,
            hints=self.hints,
        )
