"""Which videos a posterior is of together: those that were solved together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from imocap_core.artifacts.schemas import (
    Camera,
    CameraMotion,
    InitialSmpl,
    Keypoints,
    RefineSync,
    SyncMap,
    SyncSummary,
    VideoMotion,
)


@dataclass(frozen=True)
class Group:
    """Videos that were solved together, as filmed; one that was kept out is a group of its own."""

    keypoints: Keypoints
    camera_motion: CameraMotion
    initial: InitialSmpl
    sync: SyncSummary
    motions: list[VideoMotion]
    cameras: list[Camera]


def groups_of(
    keypoints: Keypoints, camera_motion: CameraMotion, initial: InitialSmpl, refined: RefineSync
) -> list[Group]:
    """First the videos that take part, then each excluded one."""
    motion, sync = refined.motion, refined.sync
    whole = Group(keypoints, camera_motion, initial, sync, motion.videos, motion.cameras)
    return [whole, *(_alone(whole, video) for video in sync.excluded)]


def _alone(whole: Group, video: str) -> Group:
    """An excluded video as an action of one video."""
    at = [v.id for v in whole.keypoints.videos].index(video)
    seen = whole.keypoints.videos[at]
    frames = len(seen.frames)
    identity = SyncMap(
        id=video, reference_frame=np.arange(frames, dtype=float), confidence=np.ones(frames)
    )
    return Group(
        Keypoints(videos=[seen]),
        CameraMotion(videos=[whole.camera_motion.videos[at]]),
        whole.initial.model_copy(update={"videos": [whole.initial.videos[at]]}),
        SyncSummary(
            reference=video,
            ids=[video],
            lengths=[frames],
            maps=[identity],
            method="none",
            centrality=np.ones(1),
            status="alone",
        ),
        [whole.motions[at]],
        [whole.cameras[at]],
    )
