"""Confidence of the loop's correspondences, where performances differ.

In the loop every pose has been drawn towards those that it is matched with, rightly or wrongly, and
confirms its match ever after. Where all videos show one motion the keypoints contradict a wrong
match, because nothing but time could explain them. Where performances differ, the difference
explains a wrong match as well: there a match is no surer than the monocular motions made it, which
knew nothing of each other, and the next solve trusts it no more: trusted more in every round, a
wrong match would draw the poses together until nothing contradicts it. Nor would poses that were
drawn together at the matches fit as well a repetition later: that too is told by the monocular
motions.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from imocap_core.artifacts.schemas import Sync, SyncMap, SyncSummary, SyncTrust
from imocap_core.motion.multiview.scene import DeviationSpread
from imocap_core.problem.one_motion import is_one_motion


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
