"""The results of an action's stages that are compared: monocular, single pass, after the loop."""

from __future__ import annotations

from dataclasses import dataclass

from imocap_core.artifacts.schemas import (
    Camera,
    CameraMotion,
    InitialSmpl,
    RefineSync,
    SmplBa,
    Sync,
    SyncSummary,
    VideoMotion,
)
from imocap_core.problem.relative_motion import Paths, paths_of, paths_of_initial

MONOCULAR, SINGLE_PASS, AFTER_LOOP = "monocular", "single pass", "after loop"


@dataclass(frozen=True)
class StageResult:
    """Motions in the order of the videos; cameras and synchronisation where the stage has them.

    paths: of moving cameras, where they are known.
    """

    name: str
    motions: list[VideoMotion]
    cameras: list[Camera] | None = None
    sync: SyncSummary | None = None
    paths: Paths | None = None


def stage_results(
    initial: InitialSmpl,
    sync: Sync,
    single: SmplBa,
    refined: RefineSync,
    camera_motion: CameraMotion,
) -> list[StageResult]:
    """The three results that are compared, in the order of the stages."""
    final, alone = refined.motion, paths_of_initial(initial, camera_motion)
    return [
        StageResult(MONOCULAR, initial.videos, paths=alone),
        StageResult(SINGLE_PASS, single.videos, single.cameras, sync, paths_of(single.cameras)),
        StageResult(AFTER_LOOP, final.videos, final.cameras, refined.sync, paths_of(final.cameras)),
    ]


def round_results(refined: RefineSync) -> list[StageResult]:
    """The results of the loop's rounds; round 0 is the single pass."""
    return [StageResult("round", r.motion.videos, r.motion.cameras, r.sync) for r in refined.rounds]
