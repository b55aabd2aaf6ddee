"""Synchronisation within the loop, and where the loop begins.

The first synchronisation knows monocular motions alone. One that is wrong is like no other: its
video is not central, whatever it shows, and may look like another action. So the joint motion of
the single pass decides again which videos take part (docs/decisions.md) and which of them
is the reference (docs/decisions.md), and where it decides otherwise the loop begins
there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from imocap_core.artifacts.schemas import CameraMotion, InitialSmpl, Keypoints, Sync, SyncSummary
from imocap_core.motion.multiview.alternation import LoopRound
from imocap_core.motion.multiview.scene import JointMotion
from imocap_core.params import SyncParams
from imocap_core.problem.event_timing import with_one_offset
from imocap_core.problem.hypotheses import chosen_motions, explained_keypoints
from imocap_core.problem.joint import JointProblem, shows_one_motion
from imocap_core.problem.screening_again import decided_again
from imocap_core.problem.synchronisation import (
    screening_of_motions,
    summary_of,
    synchronise_motions,
)
from imocap_core.sync import Hints

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
        self,
        problem: JointProblem,
        single_pass: LoopRound[SyncSummary, JointMotion],
        solve: Solve,
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
        reference = sync.reference
        del sync  # its memory is needed
        first = summary_of(self._of_monocular_motions(first, reference))
        problem, motion = problem.on_axis_of(first, single_pass.motion)
        return LoopBeginning(problem, replace(single_pass, sync=first, motion=motion), True), None

    def of_motion(self, begun: LoopBeginning, motion: JointMotion) -> Sync:
        """The correspondences of a motion, with the loop's videos and on its axis."""
        first = begun.single_pass.sync
        return self._of_motion(begun.problem, motion, first, first.reference)

    def _decided_again(
        self, problem: JointProblem, single_pass: LoopRound[SyncSummary, JointMotion]
    ) -> SyncSummary | None:
        """The first synchronisation's decisions, if the joint motion decides otherwise."""
        first = single_pass.sync
        second = screening_of_motions(
            problem.filmed_joints(single_pass.motion),
            explained_keypoints(self.initial, self.keypoints, first.alternatives),
            self.params,
            self.hints,
            mirrored=self.declared,
            rates=self.rates,
        )
        return decided_again(first, second)

    def _of_motion(
        self,
        problem: JointProblem,
        motion: JointMotion,
        decided: SyncSummary,
        reference: str | None,
    ) -> Sync:
        several = len(decided.ids) - len(decided.excluded) > 2
        pictures = self.by_pictures and several and shows_one_motion(motion)
        sync = synchronise_motions(
            problem.filmed_joints(motion),
            self.keypoints,
            self.params,
            self.rng(),
            reference=reference,
            decided=decided,
            hints=self.hints,
            cameras=self.cameras,
            reprojection=problem.reprojection_evidence(motion) if pictures else None,
            rates=self.rates,
        )
        return self._placed(sync)

    def _of_monocular_motions(self, decided: SyncSummary, reference: str | None) -> Sync:
        """The first synchronisation again, with other videos or on another time axis."""
        chosen = decided.alternatives
        sync = synchronise_motions(
            [motion.joints for motion in chosen_motions(self.initial, chosen)],
            explained_keypoints(self.initial, self.keypoints, chosen),
            self.params,
            self.rng(),
            reference=reference,
            decided=decided,
            hints=self.hints,
            cameras=self.cameras,
        )
        return self._placed(sync)

    def _placed(self, sync: Sync) -> Sync:
        """Correspondences of one event are one offset and rate a video."""
        return with_one_offset(sync, self.keypoints, self.sound_start_s) if self.event else sync
