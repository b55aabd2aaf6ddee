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
from imocap_core.sync.anchors import Hints, check_hints
from imocap_core.sync.comparable_poses import body_scales, check_poses, joint_weights_of
from imocap_core.sync.freeze_frames import SyncEvidence, distinct_videos, of_all_frames
from imocap_core.sync.joint_synchronisation import JointResult, synchronise_jointly
from imocap_core.sync.maps import BlockMaps, Blocks
from imocap_core.sync.screening.mirror import mirrored_poses
from imocap_core.sync.screening.registration import Keypoints2D
from imocap_core.sync.screening.screening import Screening, screen
from imocap_core.sync.warp.rate import playback_rates
from imocap_core.sync.warp.reprojection_evidence import ReprojectionEvidence

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
    poses: Sequence[Float[np.ndarray, "_T J 3"]],
    *,
    fps: Sequence[float],
    params: SyncParams,
    rng: np.random.Generator,
    confidence: Sequence[Float[np.ndarray, "_T J"]] | None = None,
    joint_weights: Float[np.ndarray, " J"] | None = None,
    reference: int | None = None,
    twins: Sequence[int] | None = None,
    mirrored: Sequence[bool | None] | None = None,
    hints: Hints | None = None,
    screening: Screening | None = None,
    keypoints: Sequence[Keypoints2D] | None = None,
    heights: Sequence[Float[np.ndarray, "_T"]] | None = None,
    reprojection: ReprojectionEvidence | None = None,
    rates: Float[np.ndarray, " M"] | None = None,
) -> SyncResult:
    """Find the counterpart in the reference video of every frame of every video.

    Frames that show one picture again (freeze frames) are one frame: one match, one observation.

    Args:
        poses: per video, one unit for all, any axes and origin (each pose is aligned rigidly),
            NaN = missing.
        fps: per video.
        params: all but `joint_weights`, which name SMPL's joints.
        rng: draws the starting factor of the method `als`.
        confidence: per video, in [0, 1].
        joint_weights: of the joints of the poses, in their order.
        reference: index of the reference video; chosen by centrality when None.
        twins: each joint's mirror twin, needed to detect mirrored videos.
        mirrored: per video True or False where that is given by the user.
        hints: anchors and forbidden spans.
        screening: mirrored and excluded videos, when they were determined before.
        keypoints: of the poses' joints in the same frames; where given, they decide which videos
            are mirrored or show another action, not the poses.
        heights: per video, height of the trunk in the unit of the poses, from any origin
            (`picture_heights`); NaN unknown.
        reprojection: keypoints and cameras of the videos that are not excluded, as reflected.
        rates: seconds of the action per second of each video (`estimated_rates`), when they were
            estimated before.

    Raises:
        ValueError: shapes that don't fit, or impossible hints; names every fault.
    """
    check_poses(poses, confidence, fps)
    M = len(poses)
    if reference is not None and not 0 <= reference < M:
        raise ValueError(f"reference: expected 0 to {M - 1}, got {reference}")
    hints = hints or Hints()
    check_hints(hints, [len(x) for x in poses])
    pictures = distinct_videos(poses, fps, keypoints)
    given = SyncEvidence(poses, confidence, hints, keypoints, heights, reprojection)
    evidence = given.of_pictures(pictures, () if screening is None else screening.excluded)
    poses, confidence = evidence.poses, _without_forbidden(evidence)
    scaled, weights = _scaled(poses, confidence, joint_weights)
    if rates is None:
        rates = playback_rates(scaled, weights, fps, params.max_rate)
    if screening is None:
        clock = [f / r for f, r in zip(fps, rates, strict=True)]
        declared, never = mirrored or [None] * M, [v == reference for v in range(M)]
        screening = screen(
            scaled, weights, clock, params, twins=twins, declared=declared,
            never_outliers=never, keypoints=evidence.keypoints,
        )  # fmt: skip
    used = [v for v in range(M) if v not in screening.excluded]
    upright = [_reflected(v, poses, confidence, screening, twins) for v in used]
    joint = synchronise_jointly(
        [x for x, _ in upright],
        fps=[fps[v] for v in used],
        rates=rates[used],
        params=params,
        rng=rng,
        confidence=None if confidence is None else [c for _, c in upright if c is not None],
        joint_weights=joint_weights,
        reference=None if reference is None else used.index(reference),
        eligible=[
            v not in screening.flipped and bool(rates[v] == 1.0) and not pictures[v].repeated
            for v in used
        ],
        hints=evidence.hints.among(used),
        heights=None if evidence.heights is None else [evidence.heights[v] for v in used],
        reprojection=evidence.reprojection,
    )
    result = _of_all_videos(joint, used, [len(x) for x in poses], screening)
    return of_all_frames(result, pictures)


def screened(
    poses: Sequence[Float[np.ndarray, "_T J 3"]],
    *,
    fps: Sequence[float],
    params: SyncParams,
    twins: Sequence[int],
    keypoints: Sequence[Keypoints2D],
    confidence: Sequence[Float[np.ndarray, "_T J"]] | None = None,
    joint_weights: Float[np.ndarray, " J"] | None = None,
    mirrored: Sequence[bool | None] | None = None,
    hints: Hints | None = None,
    rates: Float[np.ndarray, " M"] | None = None,
) -> Screening:
    """Which videos are mirrored or show another action, as `synchronise` decides it, and with its
    arguments."""
    pictures = distinct_videos(poses, fps, keypoints)
    evidence = SyncEvidence(poses, confidence, hints or Hints(), keypoints).of_pictures(pictures)
    scaled, weights = _scaled(evidence.poses, _without_forbidden(evidence), joint_weights)
    if rates is None:
        rates = playback_rates(scaled, weights, fps, params.max_rate)
    clock = [f / r for f, r in zip(fps, rates, strict=True)]
    declared = mirrored or [None] * len(poses)
    return screen(
        scaled, weights, clock, params, twins=twins, declared=declared, keypoints=evidence.keypoints
    )  # fmt: skip


def estimated_rates(
    poses: Sequence[Float[np.ndarray, "_T J 3"]],
    *,
    fps: Sequence[float],
    params: SyncParams,
    confidence: Sequence[Float[np.ndarray, "_T J"]] | None = None,
    joint_weights: Float[np.ndarray, " J"] | None = None,
    hints: Hints | None = None,
    keypoints: Sequence[Keypoints2D] | None = None,
) -> Float[np.ndarray, " M"]:
    """Seconds of the action per second of each video (`playback_rates`); arguments as of
    `synchronise`."""
    pictures = distinct_videos(poses, fps, keypoints)
    evidence = SyncEvidence(poses, confidence, hints or Hints()).of_pictures(pictures)
    scaled, weights = _scaled(evidence.poses, _without_forbidden(evidence), joint_weights)
    return playback_rates(scaled, weights, fps, params.max_rate)


def _scaled(
    poses: Sequence[np.ndarray],
    confidence: Sequence[np.ndarray] | None,
    joint_weights: np.ndarray | None,
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Poses (T_v, J, 3) in body sizes, and the weights of their joints."""
    scaled = [x / s for x, s in zip(poses, body_scales(poses), strict=True)]
    return scaled, joint_weights_of(poses, confidence, joint_weights)


def _without_forbidden(evidence: SyncEvidence) -> list[np.ndarray] | None:
    """Confidences (T_v, J), 0 in forbidden frames."""
    poses, confidence = evidence.poses, evidence.confidence
    if not evidence.hints.forbidden:
        return None if confidence is None else list(confidence)
    given = confidence or [np.ones(x.shape[:2]) for x in poses]
    forbidden = evidence.hints.forbidden_frames([len(x) for x in poses])
    return [np.where(f[:, None], 0.0, c) for f, c in zip(forbidden, given, strict=True)]


def _reflected(
    v: int,
    poses: Sequence[np.ndarray],
    confidence: Sequence[np.ndarray] | None,
    screening: Screening,
    twins: Sequence[int] | None,
) -> tuple[np.ndarray, np.ndarray | None]:
    """Poses and confidences of a video, reflected if it is to be flipped."""
    of_video = None if confidence is None else confidence[v]
    if v not in screening.flipped or twins is None:
        return poses[v], of_video
    return mirrored_poses(poses[v], twins), None if of_video is None else of_video[:, list(twins)]


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
