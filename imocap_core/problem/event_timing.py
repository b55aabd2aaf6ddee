"""One event in all videos: one offset and rate a video, in place of free correspondences."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from imocap_core.artifacts.schemas import Keypoints, Sync, SyncMap
from imocap_core.motion.event.clock import Clock, clock_of
from imocap_core.problem.joint import JointProblem


def with_one_offset(
    sync: Sync, keypoints: Keypoints, start_s: Float[np.ndarray, " M"] | None
) -> Sync:
    """The correspondences of one event: every video's frames at one offset and rate.

    Args:
        start_s: (M,) when each video file began, by its sound, or None.
    """
    reference = sync.ids.index(sync.reference)
    first_s = None
    if start_s is not None:
        first_s = start_s + [float(video.time_s[0]) for video in keypoints.videos]
    clock = clock_of(
        [m.reference_frame for m in sync.maps],
        [m.confidence for m in sync.maps],
        [video.fps for video in keypoints.videos],
        reference,
        first_s,
    )
    return on_lines(sync, clock, sync.ids, keypoints)


def on_lines(sync: Sync, clock: Clock, ids: Sequence[str], keypoints: Keypoints) -> Sync:
    """The maps and phases of a clock; those of videos that are excluded, or not its own, stay.

    ids: of the clock's videos.
    """
    places = {name: k for k, name in enumerate(ids)}
    reference = sync.ids.index(sync.reference)
    last, fps = sync.lengths[reference] - 1, keypoints.videos[reference].fps
    maps, phases = list(sync.maps), {}
    for v, old in enumerate(sync.maps):
        k = places.get(old.id)
        if k is None or old.id in sync.excluded or not np.isfinite(clock.offset[k]):
            continue
        frames = clock.reference_frames(k, sync.lengths[v], last)
        confidence = np.where(np.isfinite(frames), clock.agreement[k], 0.0)
        maps[v] = SyncMap(id=old.id, reference_frame=frames, confidence=confidence)
        phases[old.id] = clock.moments(k, sync.lengths[v]) / fps
    if sync.trust is None:
        return sync.model_copy(update={"maps": maps})
    begun = {v.id: v.phase_s for v in sync.trust.videos}[sync.reference][0]
    videos = [
        v.model_copy(update={"phase_s": begun + phases[v.id]}) if v.id in phases else v
        for v in sync.trust.videos
    ]
    trust = sync.trust.model_copy(update={"videos": videos})
    return sync.model_copy(update={"maps": maps, "trust": trust})


def clock_of_participants(problem: JointProblem, sync: Sync) -> Clock:
    """The clock whose lines the correspondences are."""
    matches, observations = problem.participants.sync(sync), problem.scene.observations
    return clock_of(
        [m.reference_frame for m in matches.maps],
        [m.confidence for m in matches.maps],
        [o.fps for o in observations],
        problem.scene.reference,
    )


def offset_by_sound(problem: JointProblem, sync: Sync) -> Bool[np.ndarray, " M"]:
    """The participants whose offset to the reference is known by their sound."""
    ids = problem.participants.sync(sync).ids
    if sync.sound_start_s is None:
        return np.zeros(len(ids), dtype=bool)
    by_id = dict(zip(sync.ids, np.isfinite(sync.sound_start_s), strict=True))
    return np.array([by_id[i] and by_id[sync.reference] for i in ids])
