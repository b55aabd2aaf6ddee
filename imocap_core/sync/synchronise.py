"""Synchronisation of videos by 3D poses (section 3.1; Eq. 1, 2): screening, then the joint
synchronisation.

Mirrored videos are reflected and videos of another action excluded (`screening`), the rest is
synchronised jointly (`joint_synchronisation`), and the result covers all videos again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from jaxtyping import Float

from imocap_core.params import SyncParams
from imocap_core.sync.affinity import Affinities, strides
from imocap_core.sync.evidence import SyncEvidence
from imocap_core.sync.freeze_frames import distinct_videos, of_all_frames, of_pictures
from imocap_core.sync.joint_synchronisation import JointResult, synchronise_jointly
from imocap_core.sync.maps import BlockMaps, Blocks
from imocap_core.sync.screening.screening import Screening, screen
from imocap_core.sync.warp.rate import playback_rates

Part = TypeVar("Part")


@dataclass(frozen=True)
class SyncResult(JointResult):
    """Position of every frame of every video in the reference video, with confidences.

    An excluded video is unmatched throughout: NaN, confidence 0, no phase, no affinity or map.

    Attributes:
        screening: mirrored and excluded videos.
        status: one sentence.
    """

    screening: Screening
    status: str


def synchronise(
    evidence: SyncEvidence,
    params: SyncParams,
    rng: np.random.Generator,
    screening: Screening | None = None,
) -> SyncResult:
    """Find the counterpart in the reference video of every frame of every video.

    Frames that show one picture again (freeze frames) are one frame: one match, one observation.

    Args:
        params: all but `joint_weights`, which name SMPL's joints.
        rng: draws the starting factor of the method `als`.
        screening: mirrored and excluded videos, when they were determined before.

    Raises:
        ValueError: shapes that don't fit, or impossible hints; names every fault.
    """
    evidence.check()
    pictures = distinct_videos(evidence)
    excluded = () if screening is None else screening.excluded
    evidence = _with_rates(of_pictures(evidence, pictures, excluded).without_forbidden(), params)
    if screening is None:
        screening = _screening_of(evidence, params)
    rates = evidence.rates
    assert rates is not None
    used = [v for v in range(len(evidence.poses)) if v not in screening.excluded]
    joint = synchronise_jointly(
        evidence.reflected(screening.flipped).among(used),
        params,
        rng,
        [
            v not in screening.flipped and bool(rates[v] == 1.0) and not pictures[v].repeated
            for v in used
        ],
    )
    return of_all_frames(_of_all_videos(joint, used, evidence.lengths, screening), pictures)


def screened(evidence: SyncEvidence, params: SyncParams) -> Screening:
    """Which videos are mirrored or show another action, as `synchronise` decides it."""
    pictures = of_pictures(evidence, distinct_videos(evidence)).without_forbidden()
    return _screening_of(_with_rates(pictures, params), params)


def estimated_rates(evidence: SyncEvidence, params: SyncParams) -> Float[np.ndarray, " M"]:
    """Seconds of the action per second of each video (`playback_rates`)."""
    pictures = of_pictures(evidence, distinct_videos(evidence)).without_forbidden()
    return playback_rates(*pictures.scaled(), evidence.fps, params.max_rate)


def _with_rates(evidence: SyncEvidence, params: SyncParams) -> SyncEvidence:
    """The evidence with the videos' rates, estimated where they are not given."""
    if evidence.rates is not None:
        return evidence
    rates = playback_rates(*evidence.scaled(), evidence.fps, params.max_rate)
    return replace(evidence, rates=rates)


def _screening_of(evidence: SyncEvidence, params: SyncParams) -> Screening:
    """The screening of videos whose rates are known; the reference is no outlier."""
    assert evidence.rates is not None
    videos = range(len(evidence.poses))
    return screen(
        *evidence.scaled(),
        [f / r for f, r in zip(evidence.fps, evidence.rates, strict=True)],
        params,
        twins=evidence.twins,
        declared=evidence.mirrored or [None] * len(videos),
        never_outliers=[v == evidence.reference for v in videos],
        keypoints=evidence.keypoints,
    )


def _of_all_videos(
    joint: JointResult, used: list[int], lengths: list[int], screening: Screening
) -> SyncResult:
    """The joint result extended by the excluded videos."""
    unmatched = [np.full(n, np.nan) for n in lengths]
    frames, phase = list(unmatched), list(unmatched)
    confidence, of_phase = ([np.zeros(n) for n in lengths] for _ in range(2))
    centrality, left_out, share = np.zeros(len(lengths)), *np.full((2, len(lengths)), np.nan)
    for k, v in enumerate(used):
        frames[v], phase[v] = joint.reference_frame[k], joint.phase[k]
        confidence[v], of_phase[v] = joint.confidence[k], joint.phase_confidence[k]
    centrality[used], left_out[used] = joint.centrality, joint.left_out_frames
    share[used] = joint.left_out_share
    repetitions = dict(zip(used, joint.repetitions, strict=True))
    return SyncResult(
        reference=used[joint.reference],
        reference_frame=frames,
        confidence=confidence,
        phase=phase,
        phase_confidence=of_phase,
        affinity=_affinities_of_all(joint.affinity, used, lengths),
        relaxed=BlockMaps(Blocks(tuple(lengths)), _renumbered(joint.relaxed.pairs, used)),
        centrality=centrality,
        matched_square=joint.matched_square,
        cycle=joint.cycle,
        cycle_residuals=[
            replace(t, videos=(used[t.videos[0]], used[t.videos[1]], used[t.videos[2]]))
            for t in joint.cycle_residuals
        ],
        left_out_frames=left_out,
        left_out_share=share,
        repetitions=[repetitions.get(v) for v in range(len(lengths))],
        screening=screening,
        status=_status(joint),
    )


def _affinities_of_all(joint: Affinities, used: list[int], lengths: list[int]) -> Affinities:
    """Those of the used videos; there are none of the others."""
    return Affinities(strides(lengths), _renumbered(joint.pairs, used))


def _renumbered(
    pairs: Mapping[tuple[int, int], Part], used: Sequence[int]
) -> dict[tuple[int, int], Part]:
    """What there is of each pair, by the videos' numbers among all."""
    return {(used[i], used[j]): part for (i, j), part in pairs.items()}


def _status(joint: JointResult) -> str:
    """One sentence: share of matched frames, mean confidence, cycle consistency."""
    others = [v for v in range(len(joint.reference_frame)) if v != joint.reference]
    if not others:
        return "one video: nothing to synchronise"
    share = np.mean(np.concatenate([np.isfinite(joint.reference_frame[v]) for v in others]))
    certain = np.mean(np.concatenate([joint.confidence[v] for v in others]))
    return (
        f"{100 * share:.0f} % of the frames matched, mean confidence {certain:.2f}; "
        f"{joint.cycle.status}"
    )
