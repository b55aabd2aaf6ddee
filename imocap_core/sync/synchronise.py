"""Synchronisation of videos by 3D poses (section 3.1; Eq. 1, 2): screening, then the joint
synchronisation.

Mirrored videos are reflected and videos of another action excluded (`screening`), the rest is
synchronised jointly (`joint_synchronisation`), and the result covers all videos again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from jaxtyping import Float

from imocap_core.params import SyncParams
from imocap_core.sync.affinity import Affinities, strides
from imocap_core.sync.evidence import SyncEvidence
from imocap_core.sync.freeze_frames import distinct_videos, of_all_frames, of_pictures
from imocap_core.sync.joint_synchronisation import SyncResult, synchronise_jointly
from imocap_core.sync.maps import BlockMaps, Blocks
from imocap_core.sync.screening.screening import Screening, screen
from imocap_core.sync.warp.rate import playback_rates

Part = TypeVar("Part")
LEAST_SHOWN = 0.9  # of the reference's frames show the person


def synchronise(
    evidence: SyncEvidence,
    params: SyncParams,
    rng: np.random.Generator,
    screening: Screening | None = None,
) -> SyncResult:
    """Find the counterpart in the reference video of every frame of every video.

    Frames that show one picture again (freeze frames) are one frame: one match, one observation.

    Args:
        rng: draws the starting factor of the method `als`.
        screening: mirrored and excluded videos, when they were determined before.

    Raises:
        ValueError: shapes that don't fit, or impossible hints; names every fault.
    """
    evidence.check()
    pictures = distinct_videos(evidence)
    excluded = () if screening is None else screening.excluded
    evidence = of_pictures(evidence, pictures, excluded).without_forbidden()
    rates = _rates_of(evidence, params)
    if screening is None:
        screening = screen(evidence, rates, params)
    used = [v for v in range(len(evidence.poses)) if v not in screening.excluded]
    eligible = [
        v not in screening.flipped
        and bool(rates[v] == 1.0)
        and not pictures[v].repeated
        and _shown_share(evidence, v) >= LEAST_SHOWN
        for v in used
    ]
    upright = replace(evidence, rates=rates).reflected(screening.flipped).among(used)
    joint = synchronise_jointly(upright, params, rng, eligible)
    return of_all_frames(_of_all_videos(joint, used, evidence.lengths, screening), pictures)


def _shown_share(evidence: SyncEvidence, v: int) -> float:
    """Share of a video's frames in which anything of the person is detected."""
    confidence = evidence.confidence
    return 1.0 if confidence is None else float((confidence[v] > 0).any(axis=1).mean())


def screened(evidence: SyncEvidence, params: SyncParams) -> Screening:
    """Which videos are mirrored or show another action, as `synchronise` decides it."""
    pictures = of_pictures(evidence, distinct_videos(evidence)).without_forbidden()
    return screen(pictures, _rates_of(pictures, params), params)


def estimated_rates(evidence: SyncEvidence, params: SyncParams) -> Float[np.ndarray, " M"]:
    """Seconds of the action per second of each video (`playback_rates`)."""
    pictures = of_pictures(evidence, distinct_videos(evidence)).without_forbidden()
    return _rates_of(replace(pictures, rates=None), params)


def _rates_of(evidence: SyncEvidence, params: SyncParams) -> Float[np.ndarray, " M"]:
    """The rates as they are given, else estimated; 1 of videos whose detections fit no body."""
    if evidence.rates is not None:
        return evidence.rates
    unfit = {*evidence.unfit} - {evidence.reference}
    fit = [v for v in range(len(evidence.poses)) if v not in unfit]
    of_fit, rates = evidence.among(fit), np.ones(len(evidence.poses))
    rates[fit] = playback_rates(*of_fit.scaled, of_fit.fps, params.max_rate)
    return rates


def _of_all_videos(
    joint: SyncResult, used: list[int], lengths: list[int], screening: Screening
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
    return replace(
        joint,
        reference=used[joint.reference],
        reference_frame=frames,
        confidence=confidence,
        phase=phase,
        phase_confidence=of_phase,
        affinity=Affinities(strides(lengths), _renumbered(joint.affinity.pairs, used)),
        relaxed=BlockMaps(Blocks(tuple(lengths)), _renumbered(joint.relaxed.pairs, used)),
        centrality=centrality,
        cycle_residuals=[
            replace(t, videos=(used[t.videos[0]], used[t.videos[1]], used[t.videos[2]]))
            for t in joint.cycle_residuals
        ],
        left_out_frames=left_out,
        left_out_share=share,
        repetitions=[repetitions.get(v) for v in range(len(lengths))],
        screening=screening,
    )


def _renumbered(
    pairs: Mapping[tuple[int, int], Part], used: Sequence[int]
) -> dict[tuple[int, int], Part]:
    """What there is of each pair, by the videos' numbers among all."""
    return {(used[i], used[j]): part for (i, j), part in pairs.items()}
