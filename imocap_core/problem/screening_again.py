"""Which videos take part, and which are mirrored, decided again by the joint motion.

The first screening knows monocular motions, and one that went wrong may make its own video, or
another, look like another action or mirrored. In a joint motion a wrong start has been put right,
or has been left out, and it tells one from the other more clearly (docs/decisions/screening.md).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from imocap_core.artifacts.schemas import Keypoints, SyncSummary
from imocap_core.conventions import SMPL_JOINTS, mirror_indices
from imocap_core.params import SyncParams
from imocap_core.problem.synchronisation import joint_weights_of, keypoints_of_joints
from imocap_core.sync.pairwise.poses import body_scales
from imocap_core.sync.pairwise.poses import joint_weights_of as weights_of_joints
from imocap_core.sync.screening.messages import sentences
from imocap_core.sync.screening.screening import Screening, screen

BEGINNINGS = (
    "seems to show another action",
    "is hardly better explained by the others' motion",
    "fits the others",
)
TWO_ARE_LEFT = "only two videos are left"


def decided_again(
    first: SyncSummary,
    joints: Sequence[Float[np.ndarray, "_ 24 3"]],
    keypoints: Keypoints,
    rates: Float[np.ndarray, " M"],
    params: SyncParams,
    declared: Sequence[bool | None],
) -> SyncSummary | None:
    """The first synchronisation's decisions with the videos left out and flipped that the joint
    motion says; None where they are the same.

    Args:
        joints: of all videos as filmed, metres: of the joint motion where they take part, else
            monocular. keypoints: as the motions explain them.
        rates: seconds of the action per second of each video.
        declared: per video True or False where the user states whether it is mirrored.
    """
    screening = _screened(joints, keypoints, rates, params, declared)
    excluded, mirrored = (
        [first.ids[v] for v in videos] for videos in (screening.excluded, screening.flipped)
    )
    if {*excluded} == {*first.excluded} and {*mirrored} == {*first.mirrored}:
        return None
    decided = first.model_copy(update={"excluded": excluded, "mirrored": mirrored})
    notes = notes_after(first, decided, sentences(screening, first.ids))
    return decided.model_copy(update={"notes": notes})


def notes_after(first: SyncSummary, decided: SyncSummary, second: Sequence[str]) -> list[str]:
    """The first screening's sentences, with those of the videos that it was wrong about replaced.

    Args:
        second: `messages.sentences` of the second screening.
    """
    changed = {*first.excluded} ^ {*decided.excluded} | {*first.mirrored} ^ {*decided.mirrored}
    about = tuple(f"{video} {begin}" for video in sorted(changed) for begin in BEGINNINGS)
    about += (TWO_ARE_LEFT,)
    return [
        *(note for note in first.notes if not note.startswith(about)),
        *(
            f"{video} at first seemed to show another action, but the joint motion of the others "
            f"explains it: it takes part"
            for video in first.excluded
            if video not in decided.excluded
        ),
        *(
            f"{video} at first seemed to be mirrored, but the joint motion of the others explains "
            f"it as it was filmed"
            for video in first.mirrored
            if video not in (*decided.mirrored, *decided.excluded)
        ),
        *(note for note in second if note.startswith(about)),
    ]


def _screened(
    joints: Sequence[Float[np.ndarray, "_ 24 3"]],
    keypoints: Keypoints,
    rates: Float[np.ndarray, " M"],
    params: SyncParams,
    declared: Sequence[bool | None],
) -> Screening:
    """The screening of motions."""
    scaled = [x / s for x, s in zip(joints, body_scales(joints), strict=True)]
    detected = [(video.confidence > 0).max(axis=1).astype(float) for video in keypoints.videos]
    confidence = [np.repeat(of_frames[:, None], 24, axis=1) for of_frames in detected]
    fps = [video.fps / rate for video, rate in zip(keypoints.videos, rates, strict=True)]
    return screen(
        scaled,
        weights_of_joints(joints, confidence, joint_weights_of(params)),
        fps,
        params,
        twins=mirror_indices(SMPL_JOINTS),
        declared=declared,
        keypoints=[keypoints_of_joints(video) for video in keypoints.videos],
    )
