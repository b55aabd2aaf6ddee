"""The results of an action's stages that are compared: monocular, single pass, after the loop."""

from __future__ import annotations

from dataclasses import dataclass

from imocap_core.artifacts.schemas import (
    Camera,
    InitialSmpl,
    RefineSync,
    SmplBa,
    Sync,
    SyncSummary,
    VideoMotion,
)

MONOCULAR, SINGLE_PASS, AFTER_LOOP = "monocular", "single pass", "after loop"


@dataclass(frozen=True)
class StageResult:
    """Motions in the order of the videos; cameras and synchronisation where the stage has them."""

    name: str
    motions: list[VideoMotion]
    cameras: list[Camera] | None = None
    sync: SyncSummary | None = None


def stage_results(
    initial: InitialSmpl, sync: Sync, single: SmplBa, refined: RefineSync
) -> list[StageResult]:
    """The three results that are compared, in the order of the stages."""
    return [
        StageResult(MONOCULAR, initial.videos),
        StageResult(SINGLE_PASS, single.videos, single.cameras, sync),
        StageResult(AFTER_LOOP, refined.motion.videos, refined.motion.cameras, refined.sync),
    ]


def round_results(refined: RefineSync) -> list[StageResult]:
    """The results of the loop's rounds; round 0 is the single pass."""
    return [StageResult("round", r.motion.videos, r.motion.cameras, r.sync) for r in refined.rounds]
